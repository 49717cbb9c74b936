//! The invocation mask image of a dispatch (`VK_HUAWEI_invocation_mask`): a byte an invocation, 0 for those that are not to run.

use super::grid::Tile;
use super::subgroup::lanes_of;

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

    /// Takes out the lanes of a tile that the mask excludes; what is outside the image runs.
    pub fn apply(&self, tile: &mut Tile, launch_id: impl Fn(u32) -> [u32; 3]) {
        for lane in lanes_of(tile.mask) {
            let [x, y, _] = launch_id(tile.launch[lane]);
            if x >= self.width || y >= self.height {
                continue;
            }
            let offset = u64::from(y) * self.row_stride_bytes + u64::from(x);
            // SAFETY: a texel of a 2D image of one byte a texel, which the application keeps bound and does not write meanwhile
            // (vkCmdBindInvocationMaskHUAWEI, valid usage).
            let texel = unsafe { ((self.address + offset) as *const u8).read() };
            if texel == 0 {
                tile.mask &= !(1 << lane);
            }
        }
    }
}
