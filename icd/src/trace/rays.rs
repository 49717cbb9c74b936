//! Rays in flight: one walk each, and who waits for it.

use spirv_jit::program::{AlignedRow, IO_DATA_ROW};
use traversal::{Hit, Ray, Walk};

use super::Dispatch;
use super::subgroup::LaneRef;

/// `maxRayHitAttributeSize` in words.
pub const MAX_ATTRIBUTE_WORDS: usize = 8;

/// A hit that an intersection shader reported and an any-hit shader is to decide on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    pub t: f32,
    pub hit_kind: u8,
    pub attributes: [u32; MAX_ATTRIBUTE_WORDS],
    /// The intersection invocation that waits for the verdict.
    pub reporter: LaneRef,
}

/// What a hit object says, for the shader that it names: nothing is walked.
#[derive(Clone, Copy, Debug, Default)]
pub struct Recorded {
    pub ray: Ray,
    /// `None` is a miss.
    pub hit: Option<Hit>,
}

/// What few rays have, kept apart: a batch passes over thousands of rays, and what it passes over should be small.
#[derive(Default)]
pub struct Details {
    /// The hit attribute of the committed hit, if a box's.
    pub attributes: [u32; MAX_ATTRIBUTE_WORDS],
    pub report: Report,
    /// What there is instead of a walk.
    pub recorded: Recorded,
}

/// A ray between its trace instruction and its closest-hit or miss shader's end.
#[derive(Default)]
pub struct RayInFlight {
    pub caller: LaneRef,
    /// Linear launch index of the caller.
    pub launch: u32,
    /// Device address of the top level.
    pub structure: u64,
    pub sbt_offset: u32,
    pub sbt_stride: u32,
    pub miss_index: u32,
    /// As given to the trace instruction.
    pub flags: u32,
    pub cull_mask: u32,
    /// The walk, kept to be restarted when the place is used again.
    pub walk: Option<Walk>,
    details: Option<Box<Details>>,
    /// An any-hit shader ended the search from inside an intersection shader.
    pub over: bool,
    /// When it is cast.
    pub time: f32,
    /// What is found goes into a hit object.
    pub fills_hit_object: bool,
    /// Comes from a hit object: there is no walk.
    pub is_recorded: bool,
}

impl RayInFlight {
    /// Reads the operands of a `trace_ray` that `caller` stands at and starts the walk.
    pub fn start(
        &mut self,
        caller: LaneRef,
        launch: u32,
        operands: &[AlignedRow; IO_DATA_ROW],
        dispatch: &Dispatch<'_>,
        motion: bool,
    ) {
        let lane = caller.lane as usize;
        let word = |row: usize| operands[row].0[lane];
        let float = |row| f32::from_bits(word(row));
        self.caller = caller;
        self.launch = launch;
        let named = word(0) as u64 | (word(1) as u64) << 32;
        self.structure = dispatch.limits.structure(named);
        self.flags = word(2);
        self.cull_mask = word(3) & 0xff;
        self.sbt_offset = word(4);
        self.sbt_stride = word(5);
        self.miss_index = word(6);
        self.over = false;
        self.fills_hit_object = false;
        self.is_recorded = false;
        self.time = if motion { float(15) } else { 0.0 };
        let ray = Ray {
            origin: [float(7), float(8), float(9)],
            t_min: float(10),
            direction: [float(11), float(12), float(13)],
            t_max: float(14),
            flags: self.flags | dispatch.pipeline_ray_flags,
            cull_mask: self.cull_mask,
        };
        // SAFETY: the application keeps the structures that a trace may reach built and bound until the dispatch is
        // complete (VUID-vkCmdTraceRaysKHR-None-03429 and the build commands' rules).
        unsafe {
            match &mut self.walk {
                Some(walk) => walk.restart(self.structure, &ray),
                None => self.walk = Some(Walk::new(self.structure, &ray)),
            }
        }
        let time = self.time;
        self.walk_mut().set_time(time);
    }

    /// The walk of a ray that was started.
    #[inline]
    pub fn walk(&self) -> &Walk {
        self.walk.as_ref().expect("a ray in flight was started")
    }

    /// As [`Self::walk`].
    pub fn walk_mut(&mut self) -> &mut Walk {
        self.walk.as_mut().expect("a ray in flight was started")
    }

    /// What few rays have; all zero where nothing was written since the place was made.
    pub fn details_mut(&mut self) -> &mut Details {
        self.details.get_or_insert_default()
    }

    /// As [`Self::details_mut`]; `None` where nothing was ever written.
    #[inline]
    pub fn details(&self) -> Option<&Details> {
        self.details.as_deref()
    }

    #[inline]
    fn recorded(&self) -> Option<&Recorded> {
        match &self.details {
            Some(details) if self.is_recorded => Some(&details.recorded),
            _ => None,
        }
    }

    /// The ray itself.
    #[inline]
    pub fn ray(&self) -> &Ray {
        match self.recorded() {
            Some(recorded) => &recorded.ray,
            None => self.walk().ray(),
        }
    }

    /// Upper end of the interval as it stands.
    pub fn t_max(&self) -> f32 {
        match self.recorded() {
            Some(recorded) => recorded.ray.t_max,
            None => self.walk().t_max(),
        }
    }

    /// The hit that is committed.
    #[inline]
    pub fn committed(&self) -> Option<&Hit> {
        match self.recorded() {
            Some(recorded) => recorded.hit.as_ref(),
            None => self.walk().committed(),
        }
    }

    /// Index of the hit group record for a hit (chapter Ray Tracing, "Hit Shaders").
    pub fn hit_record_index(&self, hit: &traversal::Hit) -> u32 {
        hit.instance_sbt_offset
            .wrapping_add(hit.geometry_index.wrapping_mul(self.sbt_stride))
            .wrapping_add(self.sbt_offset)
    }
}

/// A component of a point (`w` is 1) or a direction (0) in an instance's space, by its row-major world-to-object matrix.
pub fn to_object(matrix: &[f32; 12], component: usize, vector: &[f32; 3], w: f32) -> f32 {
    let row = &matrix[component * 4..][..4];
    row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] + row[3] * w
}
