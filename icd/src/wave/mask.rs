//! The invocation mask image of a dispatch (`VK_HUAWEI_invocation_mask`): a byte an invocation, 0
//! for those that are not to run.

use spirv_jit::reach::Reach;

/// Where the texels of a bound mask are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InvocationMask {
    /// Of the first texel.
    pub address: u64,
    pub row_stride_bytes: u64,
    pub width: u32,
    pub height: u32,
}

impl InvocationMask {
    /// From the first texel to the end of the last.
    pub fn size_bytes(&self) -> u64 {
        u64::from(self.height.saturating_sub(1)) * self.row_stride_bytes + u64::from(self.width)
    }
}

/// A mask all of whose texels are memory that may be read.
#[derive(Clone, Copy, Debug)]
pub struct LiveMask(InvocationMask);

impl LiveMask {
    /// The mask, if all of it is in reach.
    ///
    /// # Safety
    /// The memory in reach stays readable while the mask is used.
    pub unsafe fn new(mask: InvocationMask, reach: &Reach) -> Option<Self> {
        reach
            .contains(mask.address, mask.size_bytes())
            .then_some(Self(mask))
    }

    /// Whether the mask keeps an invocation from running; what is outside the image runs.
    pub fn excludes(&self, x: u32, y: u32) -> bool {
        let mask = &self.0;
        if x >= mask.width || y >= mask.height {
            return false;
        }
        let offset = u64::from(y) * mask.row_stride_bytes + u64::from(x);
        // SAFETY: a texel of a mask that lies entirely in live memory. A concurrent write decides
        // the value, which may be any.
        unsafe { ((mask.address + offset) as *const u8).read_volatile() == 0 }
    }
}
