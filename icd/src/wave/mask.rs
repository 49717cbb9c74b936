//! The invocation mask image of a dispatch (`VK_HUAWEI_invocation_mask`): a byte an invocation, 0 for those that are not to run.

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

    /// Whether the mask keeps an invocation from running; what is outside the image runs.
    pub fn excludes(&self, x: u32, y: u32) -> bool {
        if x >= self.width || y >= self.height {
            return false;
        }
        let offset = u64::from(y) * self.row_stride_bytes + u64::from(x);
        // SAFETY: a texel of a 2D image of one byte a texel, which the application keeps bound and does not write meanwhile
        // (vkCmdBindInvocationMaskHUAWEI, valid usage).
        unsafe { ((self.address + offset) as *const u8).read() == 0 }
    }
}
