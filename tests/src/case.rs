//! A ray tracing pipeline, what it uses and its binding table, in one chain of calls.

use ash::vk;

use crate::words::{MISS, RESULTS, WORLD};
use crate::{Bound, Buffer, Gpu, Group, Rays, Record, Set, Stage, Structure, Table, glsl};

/// Shaders of a pipeline, their groups, and a set. Groups are numbered in the order they come, the
/// ray generation shader's is 0; bindings are numbered from 0, too. A shader that several groups
/// name is one shader of the pipeline.
#[derive(Clone, Debug)]
pub struct Case {
    pub(crate) shaders: Vec<(Stage, String)>,
    pub(crate) groups: Vec<Group>,
    pub(crate) recursion: u32,
    pub(crate) flags: vk::PipelineCreateFlags,
    bindings: Vec<Vec<Bound>>,
}

impl Case {
    /// A ray generation shader, rays of which are the only ones.
    pub fn new(raygen: &str) -> Case {
        let case = Case {
            shaders: Vec::new(),
            groups: Vec::new(),
            recursion: 1,
            flags: vk::PipelineCreateFlags::empty(),
            bindings: Vec::new(),
        };
        case.general(Stage::RayGeneration, raygen)
    }

    /// A ray generation shader behind [`WORLD`] and [`RESULTS`], and [`MISS`]: for [`Case::words`].
    pub fn with_words(raygen: &str) -> Case {
        Case::new(&format!("{WORLD}{RESULTS}{raygen}")).miss(MISS)
    }

    /// A callable shader that calls itself, and nothing ends it.
    pub fn endless() -> Case {
        let raygen = r"
        layout(location = 0) callableDataEXT vec4 data;
        void main() { data = vec4(1); executeCallableEXT(0, 0); }";
        let callable = r"
        layout(location = 0) callableDataInEXT vec4 data;
        layout(location = 1) callableDataEXT vec4 next;
        void main() { next = data + 1.0; executeCallableEXT(0, 1); data = next; }";
        Case::new(raygen).callable(callable)
    }

    fn shader(&mut self, stage: Stage, source: &str) -> u32 {
        let is_it = |(is, text): &(Stage, String)| (*is, &text[..]) == (stage, source);
        let place = self.shaders.iter().position(is_it).unwrap_or_else(|| {
            self.shaders.push((stage, source.into()));
            self.shaders.len() - 1
        });
        place as u32
    }

    fn general(mut self, stage: Stage, source: &str) -> Case {
        let shader = self.shader(stage, source);
        self.groups.push(Group::general(shader));
        self
    }

    pub fn miss(self, source: &str) -> Case {
        self.general(Stage::Miss, source)
    }

    pub fn callable(self, source: &str) -> Case {
        self.general(Stage::Callable, source)
    }

    /// A hit group of this closest-hit shader.
    pub fn hit(mut self, closest_hit: &str) -> Case {
        let shader = self.shader(Stage::ClosestHit, closest_hit);
        self.groups.push(Group::hit(shader));
        self
    }

    /// A hit group without shaders, so far.
    pub fn hit_group(mut self) -> Case {
        self.groups.push(Group::default());
        self
    }

    /// An any-hit shader of the last group.
    pub fn any_hit(mut self, source: &str) -> Case {
        let shader = self.shader(Stage::AnyHit, source);
        self.last_group().any_hit = Some(shader);
        self
    }

    /// An intersection shader of the last group.
    pub fn intersection(mut self, source: &str) -> Case {
        let shader = self.shader(Stage::Intersection, source);
        self.last_group().intersection = Some(shader);
        self
    }

    fn last_group(&mut self) -> &mut Group {
        let group = self.groups.last_mut().expect("there is one");
        assert_eq!(group.general, None, "a hit group comes first");
        group
    }

    /// Puts text before each shader there is so far.
    pub fn head(mut self, text: &str) -> Case {
        for (_, source) in &mut self.shaders {
            source.insert_str(0, text);
        }
        self
    }

    pub fn recursion(self, recursion: u32) -> Case {
        Case { recursion, ..self }
    }

    pub fn flags(self, flags: vk::PipelineCreateFlags) -> Case {
        Case { flags, ..self }
    }

    /// The next binding.
    pub fn bind(self, thing: impl Into<Bound>) -> Case {
        self.bind_array(&[thing.into()])
    }

    /// The next binding, of an array.
    pub fn bind_array(mut self, things: &[Bound]) -> Case {
        self.bindings.push(things.to_vec());
        self
    }

    pub(crate) fn set(&self, gpu: &Gpu) -> Set {
        let bindings: Vec<(u32, &[Bound])> =
            (0..).zip(self.bindings.iter().map(Vec::as_slice)).collect();
        gpu.set(&bindings)
    }

    /// A record without data for each group.
    pub fn table(&self) -> Table {
        let mut table = Table::default();
        for (group, is) in self.groups.iter().enumerate() {
            let record = Record::of(group as u32);
            match is.general.map(|shader| self.shaders[shader as usize].0) {
                Some(Stage::RayGeneration) => table.raygen = record,
                Some(Stage::Miss) => table.miss.push(record),
                Some(_) => table.callable.push(record),
                None => table.hit.push(record),
            }
        }
        table
    }

    /// Makes the pipeline and the set, traces with [`Case::table`], and waits for the end.
    pub fn trace(&self, gpu: &Gpu, size: [u32; 3]) {
        gpu.trace(&gpu.rays(self), &self.table(), size);
    }

    /// Traces in a world, and reads so many words that the shaders left.
    pub fn words(self, gpu: &Gpu, world: Structure, size: [u32; 3], words: usize) -> Vec<u32> {
        let output = gpu.buffer(4 * words as u64);
        self.bind(world).bind(output).trace(gpu, size);
        output.read()
    }
}

impl Gpu {
    pub fn rays(&self, case: &Case) -> Rays {
        let words: Vec<(Stage, Vec<u32>)> = (case.shaders.iter())
            .map(|(stage, source)| (*stage, glsl(*stage, source)))
            .collect();
        let set = case.set(self);
        self.rays_of_words(&words, &case.groups, case.recursion, set, case.flags)
    }

    /// Traces straight rays along z at (x + 0.25, 0.25) for x in 0..count; returns each hit's
    /// distance, or −1.
    pub fn depths(&self, world: Structure, count: u32) -> Vec<f32> {
        let raygen = r"
        layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
        layout(set = 0, binding = 1, std430) buffer R { float results[]; };
        layout(location = 0) rayPayloadEXT float t;
        void main() {
            vec3 origin = vec3(float(gl_LaunchIDEXT.x) + 0.25, 0.25, 0.0);
            traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.0, vec3(0, 0, 1), 1e9, 0);
            results[gl_LaunchIDEXT.x] = t;
        }";
        let miss = "layout(location = 0) rayPayloadInEXT float t; void main() { t = -1.0; }";
        let hit = "layout(location = 0) rayPayloadInEXT float t; void main() { t = gl_HitTEXT; }";
        let output = self.buffer(4 * u64::from(count));
        let case = Case::new(raygen).miss(miss).hit(hit);
        let case = case.bind(world).bind(output);
        case.trace(self, [count, 1, 1]);
        output.read()
    }
}

impl From<Structure> for Bound {
    fn from(structure: Structure) -> Bound {
        Bound::Structure(structure.handle)
    }
}

/// A storage buffer.
impl From<Buffer> for Bound {
    fn from(buffer: Buffer) -> Bound {
        Bound::Storage(buffer)
    }
}
