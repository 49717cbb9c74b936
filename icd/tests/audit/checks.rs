//! The comparisons. Commands and extensions come from the tables; structures are asked for, as an
//! application would.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use ash::vk;
use vulkan_tuff::capabilities::extensions::{Extension, Kind, of_system};
use vulkan_tuff::capabilities::features;
use vulkan_tuff::capabilities::limits::API_VERSION;
use vulkan_tuff::entry::loader::{self, Availability, Level};

use crate::answers::{UNTOUCHED, answer};
use crate::condition::evaluate;
use crate::registry::{Registry, Require};

/// The version that the driver reports.
const VERSION: (u32, u32) = (
    vk::api_version_major(API_VERSION),
    vk::api_version_minor(API_VERSION),
);

/// Commands that registries list unconditionally up to some version, and later with the extension
/// whose state they set, which is not here.
const CONDITIONAL: [&str; 15] = [
    "vkCmdSetColorBlendAdvancedEXT",
    "vkCmdSetConservativeRasterizationModeEXT",
    "vkCmdSetCoverageModulationModeNV",
    "vkCmdSetCoverageModulationTableEnableNV",
    "vkCmdSetCoverageModulationTableNV",
    "vkCmdSetCoverageReductionModeNV",
    "vkCmdSetCoverageToColorEnableNV",
    "vkCmdSetCoverageToColorLocationNV",
    "vkCmdSetExtraPrimitiveOverestimationSizeEXT",
    "vkCmdSetRasterizationStreamEXT",
    "vkCmdSetRepresentativeFragmentTestEnableNV",
    "vkCmdSetSampleLocationsEnableEXT",
    "vkCmdSetShadingRateImageEnableNV",
    "vkCmdSetViewportSwizzleNV",
    "vkCmdSetViewportWScalingEnableNV",
];

/// The findings of the audit.
#[derive(Default)]
pub struct CheckReport {
    pub summary: String,
    /// Questions that this registry cannot answer.
    pub notes: Vec<String>,
    /// The errors found.
    pub findings: Vec<String>,
}

struct Audit<'a> {
    registry: &'a Registry,
    advertised: HashSet<&'static str>,
    report: CheckReport,
}

/// Holds the tables against the registry.
pub fn run(registry: &Registry) -> CheckReport {
    let names = of_system().map(name);
    let mut audit = Audit {
        registry,
        advertised: names.collect(),
        report: CheckReport::default(),
    };
    audit.extensions();
    audit.commands();
    let structures = audit.structures();
    audit.report.summary = format!(
        "{} extensions, {} commands, {structures} structures",
        of_system().count(),
        loader::table().len(),
    );
    audit.report
}

fn name(extension: Extension) -> &'static str {
    extension.name().to_str().expect("names are ASCII")
}

impl Audit<'_> {
    fn find(&mut self, finding: String) {
        self.report.findings.push(finding);
    }

    /// Whether a version, an extension (or what took it over), or a feature `structure::member` is
    /// there.
    fn holds(&self, name: &str) -> bool {
        if let Some((structure, member)) = name.split_once("::") {
            return self.feature(structure, member) == Some(true);
        }
        if let Some((_, number)) = name.split_once("_VERSION_") {
            let number = number.split_once('_');
            let number =
                number.and_then(|(a, b)| Some((a.parse::<u32>().ok()?, b.parse::<u32>().ok()?)));
            return number.is_some_and(|number| number <= VERSION);
        }
        let promoted = || {
            let extension = self.registry.extensions.get(name)?;
            Some(self.holds(extension.promoted_to.as_ref()?))
        };
        self.advertised.contains(name) || promoted().unwrap_or(false)
    }

    /// Whether a block's condition is met, by what is advertised itself.
    fn met(&self, require: &Require) -> bool {
        evaluate(&require.depends, &|name| {
            let is_extension = self.registry.extensions.contains_key(name);
            self.holds(name) && (!is_extension || self.advertised.contains(name))
        })
    }

    /// Extensions are known, of their kind, and what they depend on is there.
    fn extensions(&mut self) {
        for extension in of_system() {
            let name = name(extension);
            let Some(known) = self.registry.extensions.get(name) else {
                self.report
                    .notes
                    .push(format!("{name} is newer than this registry"));
                if self.registry.header_version >= vk::HEADER_VERSION {
                    self.find(format!("{name} is no extension"));
                }
                continue;
            };
            if known.is_instance != (extension.kind() == Kind::Instance) {
                self.find(format!("{name} is listed as {:?}", extension.kind()));
            }
            if !evaluate(&known.depends, &|name| self.holds(name)) {
                self.find(format!("{name} depends on {}", known.depends));
            }
        }
    }

    /// The commands, types and mandatory features that the advertised versions and extensions
    /// require, with the reason.
    fn required(&self) -> Vec<(String, Availability, &Require)> {
        let versions = self
            .registry
            .versions
            .iter()
            .filter(|version| version.number <= VERSION);
        let core = versions.flat_map(|version| {
            version.requires.iter().map(|require| {
                let (major, minor) = version.number;
                let since = Availability::Core(vk::make_api_version(0, major, minor, 0));
                (version.name.clone(), since, require)
            })
        });
        let extensions = of_system().filter_map(|extension| {
            let known = self.registry.extensions.get(name(extension))?;
            Some(known.requires.iter().map(move |require| {
                let by = Availability::Extension(extension);
                (known.name.clone(), by, require)
            }))
        });
        core.chain(extensions.flatten())
            .filter(|(_, _, require)| self.met(require))
            .collect()
    }

    fn commands(&mut self) {
        let mut asked: BTreeMap<&str, Vec<Availability>> = BTreeMap::new();
        let mut missing = Vec::new();
        for (who, availability, require) in self.required() {
            for command in &require.commands {
                asked.entry(command).or_default().push(availability);
                let is_there = loader::rows(command.as_bytes()).next().is_some();
                if !is_there && !CONDITIONAL.contains(&&**command) {
                    missing.push(format!("{who} has {command}, the table has not"));
                }
            }
        }
        for row in loader::table() {
            match asked.get(row.name) {
                Some(by) if by.contains(&row.availability) => {}
                _ if self.is_newer(row.availability) => {}
                _ => missing.push(format!(
                    "{}: not of what its row says, {:?}",
                    row.name, row.availability
                )),
            }
            let level = self
                .registry
                .commands
                .get(row.name)
                .map(|first| match &**first {
                    "VkInstance" => Level::Instance,
                    "VkPhysicalDevice" => Level::PhysicalDevice,
                    "VkDevice" | "VkQueue" | "VkCommandBuffer" => Level::Device,
                    _ => Level::Global,
                });
            if level.is_some_and(|level| level != row.level) {
                missing.push(format!("{} is not of level {:?}", row.name, row.level));
            }
        }
        // Two ways to a command (a version and an extension) are two rows or one.
        let unique: BTreeSet<_> = missing.into_iter().collect();
        self.report.findings.extend(unique);
    }

    fn is_newer(&self, availability: Availability) -> bool {
        match availability {
            Availability::Extension(extension) => {
                !self.registry.extensions.contains_key(name(extension))
            }
            Availability::Core(since) => {
                let since = (vk::api_version_major(since), vk::api_version_minor(since));
                self.registry
                    .versions
                    .iter()
                    .all(|known| known.number < since)
            }
        }
    }

    /// Chained structures are answered exactly if something advertised brings them, and mandatory
    /// features are true.
    fn structures(&mut self) -> usize {
        let mut wanted = BTreeSet::new();
        let mut features = BTreeSet::new();
        for (_, _, require) in self.required() {
            wanted.extend(
                require
                    .types
                    .iter()
                    .map(|name| self.registry.resolved(name)),
            );
            features.extend(require.features.iter().cloned());
        }
        let mut answered = 0;
        let (mut findings, mut notes) = (Vec::new(), Vec::new());
        for (name, structure) in &self.registry.structures {
            let answer = answer(structure);
            let Some(answer) = answer else { continue };
            let there = answer.iter().any(|&byte| byte != UNTOUCHED);
            answered += usize::from(there);
            match (there, wanted.contains(name.as_str())) {
                (true, false) => match self.conditional(name) {
                    // Registries have made conditions of what used to come with an extension.
                    Some((who, depends)) => {
                        notes.push(format!("{who} brings {name} with {depends} only"));
                    }
                    None => match self.promoted_later(name) {
                        Some(who) => notes.push(format!(
                            "{name} comes with {who}, which is newer than this registry"
                        )),
                        None => findings.push(format!("nothing advertised brings {name}")),
                    },
                },
                (false, true) => findings.push(format!("{name} is not answered")),
                _ => {}
            }
        }
        if features.is_empty() {
            self.report
                .notes
                .push("this registry does not say which features are mandatory".into());
        }
        for (structure, members) in features {
            // Where several are listed, one must be there.
            let mut one_of = members.split(',').map(str::trim);
            let met = |member| self.feature(&structure, member) != Some(false);
            if !one_of.any(met) {
                findings.push(format!("{structure}::{members} is mandatory, and false"));
            }
        }
        self.report.findings.extend(findings);
        self.report.notes.extend(notes);
        answered
    }

    /// The advertised extension that brings a type on a condition which is not met, and the
    /// condition.
    fn conditional(&self, ty: &str) -> Option<(&'static str, String)> {
        self.advertised.iter().find_map(|&who| {
            let known = self.registry.extensions.get(who)?;
            let mut requires = known.requires.iter();
            let of = requires.find(|require| require.types.iter().any(|name| name == ty))?;
            Some((who, of.depends.clone()))
        })
    }

    /// The advertised extension that brings a type in newer registries: promoted since, under the
    /// same name, from a vendor's that brings it here.
    fn promoted_later(&self, ty: &str) -> Option<&'static str> {
        let known = &self.registry.extensions;
        self.advertised.iter().copied().find(|&who| {
            !known.contains_key(who)
                && known.iter().any(|(vendors, extension)| {
                    without_author(vendors) == without_author(who)
                        && (extension.requires.iter())
                            .any(|require| require.types.iter().any(|name| name == ty))
                })
        })
    }

    /// A feature's value; `None` if this registry does not know it.
    fn feature(&self, structure: &str, member: &str) -> Option<bool> {
        if structure == "VkPhysicalDeviceFeatures" {
            return core_feature(member);
        }
        let structure = self
            .registry
            .structures
            .get(self.registry.resolved(structure))?;
        let index = structure.members.iter().position(|name| name == member)?;
        let word = answer(structure)?[index * 4..][..4].try_into().ok()?;
        Some(u32::from_ne_bytes(word) == vk::TRUE)
    }
}

/// An extension's name without `VK_` and its author's tag.
fn without_author(extension: &str) -> Option<&str> {
    let (_author, name) = extension.strip_prefix("VK_")?.split_once('_')?;
    Some(name)
}

/// Of the optional features of Vulkan 1.0, those that versions and extensions make mandatory.
fn core_feature(member: &str) -> Option<bool> {
    let core = features::core_features();
    let value = match member {
        "robustBufferAccess" => core.robust_buffer_access,
        "shaderInt64" => core.shader_int64,
        "shaderSampledImageArrayDynamicIndexing" => {
            core.shader_sampled_image_array_dynamic_indexing
        }
        "shaderStorageBufferArrayDynamicIndexing" => {
            core.shader_storage_buffer_array_dynamic_indexing
        }
        _ => return None,
    };
    Some(value == vk::TRUE)
}
