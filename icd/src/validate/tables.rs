//! Checks of a dispatch's arguments: binding tables, the size of the launch, parameters in memory.
#![forbid(unsafe_code)]

use ash::vk;
use spirv_jit::reach::Stray;

use super::registry::BufferCoverage;
use super::{Checks, Rule};
use crate::capabilities::limits::{
    MAX_RAY_DISPATCH_INVOCATIONS, MAX_SHADER_GROUP_STRIDE, SHADER_GROUP_BASE_ALIGNMENT,
    SHADER_GROUP_HANDLE_ALIGNMENT,
};
use crate::wave::binding_table::{Region, Tables};
use crate::wave::mask::InvocationMask;

/// The rules of one table. The ray generation table has one record, and so no rules about strides.
struct TableRules {
    name: &'static str,
    memory: Rule,
    usage: Rule,
    alignment: Rule,
    strides: Option<(Rule, Rule)>,
}

const RAYGEN: TableRules = TableRules {
    name: "ray generation",
    memory: Rule::RaygenMemory,
    usage: Rule::RaygenUsage,
    alignment: Rule::RaygenAlignment,
    strides: None,
};
const MISS: TableRules = TableRules {
    name: "miss",
    memory: Rule::MissMemory,
    usage: Rule::MissUsage,
    alignment: Rule::MissAlignment,
    strides: Some((Rule::MissStride, Rule::MissStrideLimit)),
};
const HIT: TableRules = TableRules {
    name: "hit",
    memory: Rule::HitMemory,
    usage: Rule::HitUsage,
    alignment: Rule::HitAlignment,
    strides: Some((Rule::HitStride, Rule::HitStrideLimit)),
};
const CALLABLE: TableRules = TableRules {
    name: "callable",
    memory: Rule::CallableMemory,
    usage: Rule::CallableUsage,
    alignment: Rule::CallableAlignment,
    strides: Some((Rule::CallableStride, Rule::CallableStrideLimit)),
};

impl Checks {
    /// Checks the four tables of a dispatch.
    pub fn tables(&self, tables: &Tables) {
        self.table(&RAYGEN, &tables.raygen);
        self.table(&MISS, &tables.miss);
        self.table(&HIT, &tables.hit);
        self.table(&CALLABLE, &tables.callable);
    }

    fn table(&self, rules: &TableRules, region: &Region) {
        let Region {
            address,
            stride_bytes,
            size_bytes,
        } = *region;
        if let Some((multiple, limit)) = rules.strides {
            let stride = || format!("the {} table's stride is {stride_bytes}", rules.name);
            let is_multiple = stride_bytes.is_multiple_of(SHADER_GROUP_HANDLE_ALIGNMENT.into());
            self.require(is_multiple, multiple, stride_bytes, stride);
            let is_in_limit = stride_bytes <= MAX_SHADER_GROUP_STRIDE.into();
            self.require(is_in_limit, limit, stride_bytes, stride);
        }
        if address == 0 {
            let is_none = size_bytes == 0;
            self.require(is_none, rules.memory, 0, || {
                format!("the {} table", rules.name)
            });
        }
        if address == 0 || size_bytes == 0 {
            return;
        }
        let place = || {
            format!(
                "the {} table is at {address:#x}, {size_bytes} bytes",
                rules.name
            )
        };
        let is_aligned = address.is_multiple_of(SHADER_GROUP_BASE_ALIGNMENT.into());
        self.require(is_aligned, rules.alignment, address, place);
        match self.validator.registry.find(address, size_bytes) {
            BufferCoverage::Outside => self.broken(Rule::TableSize, address, || {
                format!("{}, which no buffer holds", place())
            }),
            BufferCoverage::Inside(usage) => self.require(
                usage.contains(vk::BufferUsageFlags::SHADER_BINDING_TABLE_KHR),
                rules.usage,
                address,
                place,
            ),
        }
    }

    /// Checks the launch size.
    pub fn extent(&self, extent: [u32; 3]) {
        let place = extent.iter().fold(0u64, |sum, &n| sum ^ u64::from(n));
        self.require(
            invocations(extent).is_some(),
            Rule::Invocations,
            place,
            || format!("the launch is of {extent:?}"),
        );
    }

    /// Checks an invocation mask against the launch.
    pub fn mask(&self, mask: &InvocationMask, extent: [u32; 3]) {
        let [width, height, depth] = extent;
        let detail = || {
            let size = (mask.width, mask.height);
            format!("the mask is of {size:?}, the launch of {extent:?}")
        };
        let matches = (width, height) == (mask.width, mask.height);
        self.require(matches, Rule::MaskSize, mask.address, detail);
        self.require(depth == 1, Rule::MaskDepth, mask.address, detail);
    }

    /// Reports invalid and misaligned physical pointers of shaders.
    pub fn strays(&self, strays: &[Stray]) {
        for stray in strays {
            let place = stray.program << 32 | stray.site as u64;
            let rule = match stray.alignment {
                0 => Rule::PhysicalPointer,
                _ => Rule::PointerAlignment,
            };
            self.broken_times(rule, place, stray.count, || match stray.alignment {
                0 => format!("a shader follows {:#x}", stray.address),
                bytes => format!("{:#x} is not a multiple of {bytes}", stray.address),
            });
        }
    }

    /// Checks the memory of a command's parameters.
    pub fn indirect(&self, address: u64, size_bytes: u64) {
        let place = || format!("the parameters are at {address:#x}");
        let is_aligned = address.is_multiple_of(4);
        self.require(is_aligned, Rule::IndirectAlignment, address, place);
        match self.validator.registry.find(address, size_bytes) {
            BufferCoverage::Outside => self.broken(Rule::IndirectSize, address, || {
                format!("{}, where no buffer has {size_bytes} bytes", place())
            }),
            BufferCoverage::Inside(usage) => self.require(
                usage.contains(vk::BufferUsageFlags::INDIRECT_BUFFER),
                Rule::IndirectUsage,
                address,
                place,
            ),
        }
    }
}

/// The number of invocations of a launch; `None` above `maxRayDispatchInvocationCount`.
pub fn invocations(extent: [u32; 3]) -> Option<u64> {
    extent
        .iter()
        .try_fold(1u64, |product, &n| product.checked_mul(n.into()))
        .filter(|&count| count <= MAX_RAY_DISPATCH_INVOCATIONS.into())
}
