//! Profiles of Vulkan, as the files of Vulkan-Profiles describe them, against a device: extensions,
//! features, properties and formats. What a profile lists as optional is not asked for.

use serde_json::{Map, Value};

use crate::layout::{MemberKind, MemberLayout, whole};
use crate::registry::Registry;

/// A device's answers.
pub trait Device {
    /// The version of Vulkan: major, minor and patch.
    fn version(&self) -> [u32; 3];
    /// The revision of an extension; `None` if it is not advertised.
    fn extension(&self, name: &str) -> Option<u32>;
    /// A structure of features or properties; `None` if it is neither.
    fn structure(&self, registry: &Registry, name: &str) -> Option<Vec<u8>>;
    /// `VkFormatProperties3` of a format: with linear and optimal tiling, and of buffers.
    fn format(&self, format: i32) -> [u64; 3];
}

/// The names of the profiles of the files, with what the device lacks of each.
///
/// # Errors
/// A file that is no file of profiles, or that names what no file has.
pub fn missing(
    registry: &Registry,
    device: &dyn Device,
    files: &[Value],
) -> Result<Vec<(String, Vec<String>)>, String> {
    let mut all = Vec::new();
    for file in files {
        let profiles = object(file, "profiles")?;
        for (name, profile) in profiles {
            let mut check = Check {
                registry,
                device,
                found: Vec::new(),
            };
            check.profile(files, file, profile)?;
            check.found.sort();
            check.found.dedup();
            all.push((name.clone(), check.found));
        }
    }
    Ok(all)
}

fn object<'a>(value: &'a Value, key: &str) -> Result<&'a Map<String, Value>, String> {
    let object = value.get(key).and_then(Value::as_object);
    object.ok_or_else(|| format!("there is no object \"{key}\""))
}

/// The strings of an array, none if there is no array.
fn strings<'a>(value: &'a Value, key: &str) -> Vec<&'a str> {
    let array = value.get(key).and_then(Value::as_array);
    array.map_or_else(Vec::new, |it| it.iter().filter_map(Value::as_str).collect())
}

struct Check<'a> {
    registry: &'a Registry,
    device: &'a dyn Device,
    found: Vec<String>,
}

/// A value of a member.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Number {
    Whole(i128),
    Float(f64),
}

impl Check<'_> {
    /// A profile with the profiles that it builds on.
    fn profile(&mut self, files: &[Value], file: &Value, profile: &Value) -> Result<(), String> {
        if let Some(version) = profile.get("api-version").and_then(Value::as_str) {
            let mut numbers = version.split('.').map(|it| it.parse().unwrap_or(u32::MAX));
            let wanted: [u32; 3] = std::array::from_fn(|_| numbers.next().unwrap_or(0));
            let [major, minor, patch] = self.device.version();
            if [major, minor, patch] < wanted {
                let found = format!("Vulkan {version}: the device has {major}.{minor}.{patch}");
                self.found.push(found);
            }
        }
        for name in strings(profile, "profiles") {
            let base = files.iter().find_map(|file| {
                let profile = file.get("profiles")?.get(name)?;
                Some((file, profile))
            });
            let (file, base) = base.ok_or_else(|| format!("no file has the profile {name}"))?;
            self.profile(files, file, base)?;
        }
        let capabilities = object(file, "capabilities")?;
        let named = |name: &Value| {
            let name = name.as_str().unwrap_or_default();
            let set = capabilities.get(name);
            set.ok_or_else(|| format!("there are no capabilities \"{name}\""))
        };
        let wanted = profile.get("capabilities").and_then(Value::as_array);
        for item in wanted.into_iter().flatten() {
            match item {
                // One of them.
                Value::Array(sets) => {
                    let mut lacks = Vec::new();
                    for set in sets {
                        let mut check = Check {
                            found: Vec::new(),
                            ..*self
                        };
                        check.capabilities(named(set)?);
                        lacks.push(check.found);
                    }
                    if !lacks.iter().any(Vec::is_empty) {
                        let lacks: Vec<_> = lacks.iter().map(|it| it.join(" and ")).collect();
                        self.found.push(format!("one of: {}", lacks.join("; or ")));
                    }
                }
                name => self.capabilities(named(name)?),
            }
        }
        Ok(())
    }

    fn capabilities(&mut self, set: &Value) {
        for (kind, items) in set.as_object().into_iter().flatten() {
            for (name, wanted) in items.as_object().into_iter().flatten() {
                match kind.as_str() {
                    "extensions" => self.extension(name, wanted),
                    "features" | "properties" => self.structure(name, wanted),
                    "formats" => self.format(name, wanted),
                    _ => {}
                }
            }
            let is_known = ["extensions", "features", "properties", "formats"];
            if !is_known.contains(&kind.as_str()) {
                self.found.push(format!("{kind}: not compared"));
            }
        }
    }

    fn extension(&mut self, name: &str, wanted: &Value) {
        let wanted = wanted.as_u64().unwrap_or(0);
        match self.device.extension(name) {
            None => self.found.push(name.to_owned()),
            Some(version) if u64::from(version) < wanted => {
                (self.found).push(format!("{name} of revision {wanted}: {version} is there"));
            }
            Some(_) => {}
        }
    }

    fn structure(&mut self, name: &str, wanted: &Value) {
        // The structures that only hold those of Vulkan 1.0.
        let inner = match name {
            "VkPhysicalDeviceFeatures2" | "VkPhysicalDeviceFeatures2KHR" => Some("features"),
            "VkPhysicalDeviceProperties2" | "VkPhysicalDeviceProperties2KHR" => Some("properties"),
            _ => None,
        };
        if let Some(inner) = inner.and_then(|inner| wanted.get(inner)) {
            let name = name.trim_end_matches("KHR").trim_end_matches('2');
            return self.structure(name, inner);
        }
        let name = self.registry.resolved(name);
        let Some(wanted) = wanted.as_object() else {
            return self.found.push(format!("{name}: not an object"));
        };
        match self.device.structure(self.registry, name) {
            // The members of features have no way to compare: they are capabilities.
            Some(bytes) => self.members(name, name, &bytes, wanted, "max"),
            None => self.found.push(format!("{name}: not compared")),
        }
    }

    fn members(
        &mut self,
        path: &str,
        structure: &str,
        bytes: &[u8],
        wanted: &Map<String, Value>,
        inherited: &str,
    ) {
        for (member, wanted) in wanted {
            let path = format!("{path}::{member}");
            let Some(place) = self.registry.layouts.place(structure, member) else {
                self.found.push(format!("{path}: not in this registry"));
                continue;
            };
            let limit = place.limit.as_deref().unwrap_or(inherited);
            if let (MemberKind::Structure(name), Some(wanted)) = (&place.kind, wanted.as_object()) {
                let bytes = bytes.get(place.offset_bytes..).unwrap_or_default();
                self.members(&path, name, bytes, wanted, limit);
                continue;
            }
            let elements = match wanted {
                Value::Array(elements) if place.count > 1 => &elements[..],
                _ => std::slice::from_ref(wanted),
            };
            for (index, wanted) in elements.iter().enumerate() {
                let there = read(&place, index, bytes);
                let met = self.number(wanted).zip(there).map(|(wanted, there)| {
                    let mut ways = limit.split(',');
                    ways.all(|way| satisfies(way, index, there, wanted))
                });
                let there = match there {
                    Some(Number::Whole(number)) => number.to_string(),
                    Some(Number::Float(number)) => number.to_string(),
                    None => "unknown".to_owned(),
                };
                match met {
                    Some(true) => {}
                    Some(false) => (self.found).push(format!("{path} = {wanted}: it is {there}")),
                    None => self.found.push(format!("{path} = {wanted}: not compared")),
                }
            }
        }
    }

    /// The number that a value of a profile means: bits and enumerators by their names.
    fn number(&self, value: &Value) -> Option<Number> {
        Some(match value {
            Value::Bool(is) => Number::Whole((*is).into()),
            Value::Number(number) => match (number.as_i64(), number.as_u64()) {
                (Some(number), _) => Number::Whole(number.into()),
                (_, Some(number)) => Number::Whole(number.into()),
                _ => Number::Float(number.as_f64()?),
            },
            Value::String(name) => {
                let number = self.registry.layouts.constant(name);
                Number::Whole(number.or_else(|| whole(name))?)
            }
            Value::Array(names) => {
                let mut bits = 0;
                for name in names {
                    bits |= self.registry.layouts.constant(name.as_str()?)?;
                }
                Number::Whole(bits)
            }
            _ => return None,
        })
    }

    fn format(&mut self, name: &str, wanted: &Value) {
        let number = self.registry.layouts.constant(name);
        let Some(Ok(number)) = number.map(i32::try_from) else {
            return self.found.push(format!("{name}: not in this registry"));
        };
        let there = self.device.format(number);
        for (structure, wanted) in wanted.as_object().into_iter().flatten() {
            let wanted = wanted.get("formatProperties").unwrap_or(wanted);
            for (member, bits) in wanted.as_object().into_iter().flatten() {
                let there = match member.as_str() {
                    "linearTilingFeatures" => there[0],
                    "optimalTilingFeatures" => there[1],
                    "bufferFeatures" => there[2],
                    _ => {
                        self.found
                            .push(format!("{name}, {structure}::{member}: not compared"));
                        continue;
                    }
                };
                for bit in bits.as_array().into_iter().flatten() {
                    let is_there = match self.number(bit) {
                        Some(Number::Whole(bit)) => i128::from(there) & bit == bit,
                        _ => false,
                    };
                    if !is_there {
                        self.found.push(format!("{name}, {member}: {bit}"));
                    }
                }
            }
        }
    }
}

/// An element of a member.
fn read(place: &MemberLayout, index: usize, bytes: &[u8]) -> Option<Number> {
    let start = place.offset_bytes + index * place.size_bytes;
    let bytes = bytes.get(start..start + place.size_bytes)?;
    let mut wide = [0; 8];
    wide.get_mut(..bytes.len())?.copy_from_slice(bytes);
    let unsigned = u64::from_le_bytes(wide);
    Some(match place.kind {
        MemberKind::Unsigned(_) => Number::Whole(unsigned.into()),
        MemberKind::Signed(size) => {
            let unused = 64 - 8 * size as u32;
            Number::Whole(((unsigned << unused) as i64 >> unused).into())
        }
        MemberKind::Float(4) => Number::Float(f32::from_bits(unsigned as u32).into()),
        MemberKind::Float(_) => Number::Float(f64::from_bits(unsigned)),
        MemberKind::Structure(_) | MemberKind::Pointer => return None,
    })
}

/// Whether a device's value meets what is wanted, by one way to compare (`limittype`, appendix
/// "Vulkan XML Schema").
fn satisfies(way: &str, index: usize, there: Number, wanted: Number) -> bool {
    let whole = |number| match number {
        Number::Whole(number) => number,
        Number::Float(number) => number as i128,
    };
    // Of two floats, or of a float and what the file writes as a whole number.
    let (there, wanted) = match (there, wanted) {
        (Number::Float(_), Number::Whole(wanted)) => (there, Number::Float(wanted as f64)),
        both => both,
    };
    match way {
        "max" | "bits" => there >= wanted,
        "min" => there <= wanted,
        "range" if index == 0 => there <= wanted,
        "range" => there >= wanted,
        "pot" => u128::try_from(whole(there)).is_ok_and(u128::is_power_of_two),
        "mul" => match (there, wanted) {
            (Number::Float(there), Number::Float(wanted)) => (wanted / there).fract() == 0.0,
            _ => whole(wanted).checked_rem(whole(there)) == Some(0),
        },
        "bitmask" => whole(there) & whole(wanted) == whole(wanted),
        _ => there == wanted,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const REGISTRY: &str = r#"<registry>
        <types>
            <type category="basetype">typedef <type>uint32_t</type> <name>VkFlags</name>;</type>
            <type category="bitmask">typedef <type>VkFlags</type> <name>VkWays</name>;</type>
            <type category="struct" name="VkPair">
                <member><type>uint32_t</type> <name>width</name></member>
                <member><type>uint32_t</type> <name>height</name></member>
            </type>
            <type category="struct" name="VkMadeUp">
                <member limittype="max"><type>uint32_t</type> <name>most</name></member>
                <member limittype="min,pot"><type>uint64_t</type> <name>step</name></member>
                <member limittype="bitmask"><type>VkWays</type> <name>ways</name></member>
                <member limittype="range"><type>float</type> <name>range</name>[2]</member>
                <member limittype="max"><type>VkPair</type> <name>pair</name></member>
                <member limittype="exact"><type>int32_t</type> <name>same</name></member>
                <member limittype="min,mul"><type>float</type> <name>grain</name></member>
            </type>
            <type category="struct" name="VkOld" alias="VkMadeUp"/>
        </types>
        <enums>
            <enum name="VK_WAY_A" bitpos="0"/>
            <enum name="VK_WAY_B" bitpos="1"/>
            <enum name="VK_FORMAT_MADE_UP" value="7"/>
        </enums>
    </registry>"#;

    struct FakeDevice;

    impl Device for FakeDevice {
        fn version(&self) -> [u32; 3] {
            [1, 2, 3]
        }

        fn extension(&self, name: &str) -> Option<u32> {
            (name == "VK_EXT_there").then_some(2)
        }

        /// 9, 16, `VK_WAY_A`, [-1.0, 8.0], (3, 5), -4, 0.125.
        fn structure(&self, _registry: &Registry, name: &str) -> Option<Vec<u8>> {
            assert_eq!(name, "VkMadeUp");
            let range = [(-1.0f32).to_bits(), 8.0f32.to_bits()];
            let grain = 0.125f32.to_bits();
            let words = [
                9,
                0,
                16,
                0,
                1,
                range[0],
                range[1],
                3,
                5,
                -4i32 as u32,
                grain,
            ];
            Some(words.into_iter().flat_map(u32::to_le_bytes).collect())
        }

        fn format(&self, format: i32) -> [u64; 3] {
            assert_eq!(format, 7);
            [1, 3, 0]
        }
    }

    fn lacks(capabilities: Value) -> Vec<String> {
        let file = json!({
            "capabilities": { "all": capabilities },
            "profiles": { "VP_made_up": { "api-version": "1.2.3", "capabilities": ["all"] } },
        });
        let registry = Registry::parse(REGISTRY).unwrap();
        let mut all = missing(&registry, &FakeDevice, &[file]).unwrap();
        assert_eq!(all.len(), 1);
        all.remove(0).1
    }

    #[test]
    fn what_is_there_is_not_missing() {
        let found = lacks(json!({
            "extensions": { "VK_EXT_there": 1 },
            "properties": { "VkOld": {
                "most": 9, "step": 64, "ways": ["VK_WAY_A"], "range": [-0.5, 8],
                "pair": { "width": 2, "height": 5 }, "same": -4, "grain": 0.5,
            } },
            "formats": { "VK_FORMAT_MADE_UP": { "VkFormatProperties": {
                "optimalTilingFeatures": ["VK_WAY_A", "VK_WAY_B"],
            } } },
        }));
        assert!(found.is_empty(), "{found:?}");
    }

    #[test]
    fn what_is_missing_is_listed() {
        let found = lacks(json!({
            "extensions": { "VK_EXT_there": 3, "VK_EXT_not_there": 1 },
            "properties": { "VkMadeUp": {
                "most": 10, "step": 8, "ways": ["VK_WAY_A", "VK_WAY_B"], "range": [-2.0, 8.5],
                "pair": { "height": 6 }, "same": 4, "newer": true, "grain": 0.3,
            } },
            "formats": { "VK_FORMAT_MADE_UP": { "VkFormatProperties": {
                "linearTilingFeatures": ["VK_WAY_B"],
            } } },
        }));
        assert_eq!(
            found,
            [
                "VK_EXT_not_there",
                "VK_EXT_there of revision 3: 2 is there",
                "VK_FORMAT_MADE_UP, linearTilingFeatures: \"VK_WAY_B\"",
                "VkMadeUp::grain = 0.3: it is 0.125",
                "VkMadeUp::most = 10: it is 9",
                "VkMadeUp::newer: not in this registry",
                "VkMadeUp::pair::height = 6: it is 5",
                "VkMadeUp::range = -2.0: it is -1",
                "VkMadeUp::range = 8.5: it is 8",
                "VkMadeUp::same = 4: it is -4",
                "VkMadeUp::step = 8: it is 16",
                "VkMadeUp::ways = [\"VK_WAY_A\",\"VK_WAY_B\"]: it is 1",
            ]
        );
    }

    #[test]
    fn profiles_build_on_others_and_may_offer_a_choice() {
        let most = |most: u32| json!({ "properties": { "VkMadeUp": { "most": most } } });
        let file = json!({
            "capabilities": { "a": most(10), "b": most(8), "c": most(11) },
            "profiles": {
                "VP_base": { "api-version": "1.2.4", "capabilities": [["a", "b"]] },
                "VP_built": {
                    "api-version": "1.1.0",
                    "profiles": ["VP_base"],
                    "capabilities": [["a", "c"]],
                },
                "VP_lost": { "profiles": ["VP_none"] },
            },
        });
        let registry = Registry::parse(REGISTRY).unwrap();
        let lost = missing(&registry, &FakeDevice, std::slice::from_ref(&file));
        assert_eq!(lost.err().unwrap(), "no file has the profile VP_none");
        let mut file = file;
        file["profiles"].as_object_mut().unwrap().remove("VP_lost");
        let all = missing(&registry, &FakeDevice, &[file]).unwrap();
        let old = "Vulkan 1.2.4: the device has 1.2.3".to_owned();
        let choice = "one of: VkMadeUp::most = 10: it is 9; or VkMadeUp::most = 11: it is 9";
        assert_eq!(
            all,
            [
                ("VP_base".to_owned(), vec![old.clone()]),
                ("VP_built".to_owned(), vec![old, choice.to_owned()]),
            ]
        );
    }
}
