//! The parts of `vk.xml` that the audit reads.

use std::collections::{BTreeMap, HashMap};

use roxmltree::{Document, Node};

use crate::layout::Layouts;
use crate::xml::{child_text, elements, is_vulkan};

/// An extension.
pub struct RegistryExtension {
    pub name: String,
    pub is_instance: bool,
    /// Empty if there is no such condition.
    pub depends: String,
    /// The version or extension that took it over.
    pub promoted_to: Option<String>,
    pub requires: Vec<Require>,
}

/// A version of Vulkan.
pub struct Version {
    pub name: String,
    pub number: (u32, u32),
    pub requires: Vec<Require>,
}

/// The contents of a version or extension, if `depends` holds.
#[derive(Default)]
pub struct Require {
    pub depends: String,
    pub commands: Vec<String>,
    pub types: Vec<String>,
    /// Structure and member, for features that must be true; of several members, one.
    pub features: Vec<(String, String)>,
}

/// A structure that can be chained.
pub struct Structure {
    pub ty: i32,
    pub extends: Vec<String>,
    /// After `sType` and `pNext`.
    pub members: Vec<String>,
    pub has_pointers: bool,
}

/// The registry.
#[derive(Default)]
pub struct Registry {
    pub header_version: u32,
    pub versions: Vec<Version>,
    pub extensions: BTreeMap<String, RegistryExtension>,
    /// First argument's type, by command.
    pub commands: HashMap<String, String>,
    pub structures: BTreeMap<String, Structure>,
    /// Old names of structures.
    pub aliases: HashMap<String, String>,
    pub layouts: Layouts,
}

impl Registry {
    /// The newest name of a structure.
    pub fn resolved<'a>(&'a self, name: &'a str) -> &'a str {
        (self.aliases.get(name)).map_or(name, |alias| self.resolved(alias))
    }

    /// Reads `vk.xml`.
    pub fn parse(text: &str) -> Result<Self, roxmltree::Error> {
        let document = Document::parse(text)?;
        let root = document.root_element();
        let mut registry = Self {
            layouts: Layouts::read(root),
            ..Self::default()
        };
        for node in root.descendants().filter(|node| node.is_element()) {
            match node.tag_name().name() {
                "type" => registry.add_type(node),
                "command" => registry.add_command(node),
                "feature" if node.has_attribute("number") => registry.add_version(node),
                "extension" => registry.add_extension(node),
                _ => {}
            }
        }
        Ok(registry)
    }

    fn add_type(&mut self, node: Node<'_, '_>) {
        if !is_vulkan(node) {
            return;
        }
        if child_text(node, "name") == Some("VK_HEADER_VERSION") {
            let text: String = node.children().filter_map(|child| child.text()).collect();
            let digits = text.split_whitespace().last().unwrap_or_default();
            self.header_version = digits.parse().unwrap_or(0);
        }
        let (Some("struct"), Some(name)) = (node.attribute("category"), node.attribute("name"))
        else {
            return;
        };
        if let Some(alias) = node.attribute("alias") {
            self.aliases.insert(name.into(), alias.into());
            return;
        }
        let members: Vec<_> = elements(node, "member").collect();
        let ty = members.iter().find_map(|member| member.attribute("values"));
        let (Some(ty), Some(extends)) = (ty, node.attribute("structextends")) else {
            return;
        };
        let Some(Ok(ty)) = self.layouts.constant(ty).map(i32::try_from) else {
            return;
        };
        let is_pointer = |member: &Node<'_, '_>| {
            let text = member.children().filter_map(|child| child.tail());
            text.into_iter().any(|text| text.contains('*'))
        };
        let names = members
            .iter()
            .filter_map(|member| child_text(*member, "name"));
        let structure = Structure {
            ty,
            extends: extends.split(',').map(str::to_owned).collect(),
            members: names.skip(2).map(str::to_owned).collect(),
            has_pointers: members.iter().skip(2).any(is_pointer),
        };
        self.structures.insert(name.into(), structure);
    }

    fn add_command(&mut self, node: Node<'_, '_>) {
        if !is_vulkan(node) || !node.has_children() {
            return;
        }
        let name = elements(node, "proto")
            .next()
            .and_then(|proto| child_text(proto, "name"));
        let first = elements(node, "param")
            .next()
            .and_then(|param| child_text(param, "type"));
        if let (Some(name), Some(first)) = (name, first) {
            self.commands.insert(name.into(), first.into());
        }
    }

    fn add_version(&mut self, node: Node<'_, '_>) {
        let number = node.attribute("number").unwrap_or_default().split_once('.');
        let number =
            number.and_then(|(major, minor)| Some((major.parse().ok()?, minor.parse().ok()?)));
        if let (true, Some(number)) = (is_vulkan(node), number) {
            self.versions.push(Version {
                name: node.attribute("name").unwrap_or_default().into(),
                number,
                requires: requires(node),
            });
        }
    }

    fn add_extension(&mut self, node: Node<'_, '_>) {
        let supported = node.attribute("supported").unwrap_or_default();
        if !supported.split(',').any(|api| api == "vulkan") {
            return;
        }
        let name = node.attribute("name").unwrap_or_default();
        let extension = RegistryExtension {
            name: name.into(),
            is_instance: node.attribute("type") == Some("instance"),
            depends: dependencies(node),
            promoted_to: node.attribute("promotedto").map(str::to_owned),
            requires: requires(node),
        };
        self.extensions.insert(name.into(), extension);
    }
}

/// A condition over versions and extensions: names, `+` for and, `,` for or, parentheses; older
/// registries have a list that must hold whole, and one of which any will do.
fn dependencies(node: Node<'_, '_>) -> String {
    match node.attribute("depends") {
        Some(depends) => depends.into(),
        None => {
            let all = node.attribute("requires");
            let all = all.map(|list| list.replace(',', "+"));
            let any = node.attribute("extension");
            let any = any.map(|list| format!("({list})"));
            all.into_iter().chain(any).collect::<Vec<_>>().join("+")
        }
    }
}

fn requires(node: Node<'_, '_>) -> Vec<Require> {
    elements(node, "require")
        .filter(|require| is_vulkan(*require))
        .map(|require| {
            let named = |tag| {
                elements(require, tag)
                    .filter_map(|item| Some(item.attribute("name")?.to_owned()))
                    .collect()
            };
            let features = elements(require, "feature").map(|feature| {
                let attribute = |name| feature.attribute(name).unwrap_or_default().to_owned();
                (attribute("struct"), attribute("name"))
            });
            Require {
                depends: [dependencies(require)]
                    .into_iter()
                    .chain(require.attribute("feature").map(str::to_owned))
                    .filter(|condition| !condition.is_empty())
                    .collect::<Vec<_>>()
                    .join("+"),
                commands: named("command"),
                types: named("type"),
                features: features.collect(),
            }
        })
        .collect()
}
