//! Layouts of C structures, and constants, as `vk.xml` describes them.

use std::collections::{HashMap, HashSet};

use roxmltree::Node;

use crate::xml::{child_text, elements, is_vulkan};

/// A member's type, as far as values of it are compared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MemberKind {
    /// Of a size in bytes: numbers, flags, booleans.
    Unsigned(usize),
    /// Signed numbers, and enumerations.
    Signed(usize),
    Float(usize),
    /// A structure of this name.
    Structure(String),
    Pointer,
}

/// The place of a member in its structure.
#[derive(Clone, Debug)]
pub struct MemberLayout {
    pub offset_bytes: usize,
    /// Of one element.
    pub size_bytes: usize,
    /// Elements of an array; one, if it is none.
    pub count: usize,
    pub kind: MemberKind,
    /// The way to compare (`limittype`).
    pub limit: Option<String>,
}

struct Member {
    name: String,
    ty: String,
    count: usize,
    is_pointer: bool,
    limit: Option<String>,
}

/// Layouts of structures, and the values of constants.
#[derive(Default)]
pub struct Layouts {
    structures: HashMap<String, Vec<Member>>,
    /// Types that are enumerations.
    enumerations: HashSet<String>,
    /// Types that are other names of types.
    names: HashMap<String, String>,
    constants: HashMap<String, i128>,
}

impl Layouts {
    /// Reads the registry's root element.
    pub fn read(root: Node<'_, '_>) -> Self {
        let mut layouts = Self {
            constants: constants(root),
            ..Self::default()
        };
        let types = root.descendants().filter(|node| node.has_tag_name("type"));
        for node in types.filter(|node| is_vulkan(*node)) {
            layouts.add(node);
        }
        layouts
    }

    /// The value of a constant.
    pub fn constant(&self, name: &str) -> Option<i128> {
        self.constants.get(name).copied()
    }

    /// The place of a member; `None` where the registry does not know it.
    pub fn place(&self, structure: &str, member: &str) -> Option<MemberLayout> {
        let mut offset_bytes = 0usize;
        for it in self.structures.get(structure)? {
            let (size_bytes, alignment) = self.size(it)?;
            offset_bytes = offset_bytes.next_multiple_of(alignment);
            if it.name == member {
                return Some(MemberLayout {
                    offset_bytes,
                    size_bytes,
                    count: it.count,
                    kind: self.kind(it)?,
                    limit: it.limit.clone(),
                });
            }
            offset_bytes += size_bytes * it.count;
        }
        None
    }

    fn add(&mut self, node: Node<'_, '_>) {
        let name = node.attribute("name").or_else(|| child_text(node, "name"));
        let Some(name) = name.map(str::to_owned) else {
            return;
        };
        if let Some(alias) = node.attribute("alias") {
            self.names.insert(name, alias.into());
            return;
        }
        match node.attribute("category") {
            Some("enum") => drop(self.enumerations.insert(name)),
            Some("bitmask" | "basetype") => {
                if let Some(ty) = child_text(node, "type") {
                    self.names.insert(name, ty.into());
                }
            }
            Some("struct") => {
                let members = elements(node, "member").filter_map(|it| self.member(it));
                self.structures.insert(name, members.collect());
            }
            _ => {}
        }
    }

    fn member(&self, node: Node<'_, '_>) -> Option<Member> {
        let texts = || node.children().filter(Node::is_text);
        let is_pointer = texts().any(|it| it.text().is_some_and(|text| text.contains('*')));
        // Behind the name: "[4]", "[", "VK_UUID_SIZE", "]".
        let behind: String = (node.children())
            .skip_while(|child| !child.has_tag_name("name"))
            .skip(1)
            .filter(|child| !child.has_tag_name("comment"))
            .filter_map(|child| child.text())
            .collect();
        let sizes = behind.split(['[', ']']).map(str::trim);
        let sizes = sizes.filter(|size| !size.is_empty());
        let number = |size: &str| {
            let number = size.parse().ok();
            number.or_else(|| usize::try_from(self.constant(size)?).ok())
        };
        Some(Member {
            name: child_text(node, "name")?.into(),
            ty: child_text(node, "type")?.into(),
            count: sizes.map(number).product::<Option<usize>>()?,
            is_pointer,
            limit: node.attribute("limittype").map(str::to_owned),
        })
    }

    fn kind(&self, member: &Member) -> Option<MemberKind> {
        match member.is_pointer {
            true => Some(MemberKind::Pointer),
            false => self.kind_of(&member.ty),
        }
    }

    fn kind_of(&self, ty: &str) -> Option<MemberKind> {
        Some(match ty {
            "char" | "uint8_t" => MemberKind::Unsigned(1),
            "uint16_t" => MemberKind::Unsigned(2),
            "uint32_t" => MemberKind::Unsigned(4),
            "uint64_t" | "size_t" => MemberKind::Unsigned(8),
            "int8_t" => MemberKind::Signed(1),
            "int16_t" => MemberKind::Signed(2),
            "int32_t" => MemberKind::Signed(4),
            "int64_t" => MemberKind::Signed(8),
            "float" => MemberKind::Float(4),
            "double" => MemberKind::Float(8),
            _ if self.structures.contains_key(ty) => MemberKind::Structure(ty.into()),
            _ if self.enumerations.contains(ty) => MemberKind::Signed(4),
            _ => return self.kind_of(self.names.get(ty)?),
        })
    }

    /// Size and alignment of an element, in bytes.
    fn size(&self, member: &Member) -> Option<(usize, usize)> {
        Some(match self.kind(member)? {
            MemberKind::Unsigned(size) | MemberKind::Signed(size) | MemberKind::Float(size) => {
                (size, size)
            }
            MemberKind::Pointer => (8, 8),
            MemberKind::Structure(name) => {
                let (mut end, mut most) = (0usize, 1);
                for member in self.structures.get(&name)? {
                    let (size, alignment) = self.size(member)?;
                    end = end.next_multiple_of(alignment) + size * member.count;
                    most = most.max(alignment);
                }
                (end.next_multiple_of(most), most)
            }
        })
    }
}

/// The values of all constants that are whole numbers.
fn constants(root: Node<'_, '_>) -> HashMap<String, i128> {
    let mut values = HashMap::new();
    let mut aliases = Vec::new();
    for node in root.descendants().filter(|node| node.has_tag_name("enum")) {
        let Some(name) = node.attribute("name") else {
            continue;
        };
        let number = |attribute: &str| whole(node.attribute(attribute)?);
        let of_extension = || {
            node.ancestors()
                .find_map(|parent| parent.attribute("number")?.parse().ok())
        };
        if let Some(alias) = node.attribute("alias") {
            aliases.push((name.to_owned(), alias.to_owned()));
        } else if let Some(value) = number("value") {
            values.insert(name.to_owned(), value);
        } else if let Some(bit) = number("bitpos") {
            values.insert(name.to_owned(), 1 << bit);
        } else if let (Some(offset), Some(extension)) =
            (number("offset"), number("extnumber").or_else(of_extension))
        {
            let value = 1_000_000_000 + (extension - 1) * 1000 + offset;
            let is_negative = node.attribute("dir") == Some("-");
            values.insert(name.to_owned(), if is_negative { -value } else { value });
        }
    }
    // An alias may name another one.
    for _ in 0..3 {
        for (name, alias) in &aliases {
            if let Some(&value) = values.get(alias) {
                values.insert(name.clone(), value);
            }
        }
    }
    values
}

/// A whole number, decimal or hexadecimal, with or without a suffix of C.
pub fn whole(text: &str) -> Option<i128> {
    let text = text.trim_end_matches(['U', 'L', 'u', 'l']);
    match text.strip_prefix("0x") {
        Some(digits) => i128::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}
