//! The placement of an image on a window of another size
//! (`VkSwapchainPresentScalingCreateInfoKHR`).

#![forbid(unsafe_code)]

use ash::vk;

use super::pixels::Placement;

/// The scaling of a swapchain. Without a behavior its images lie in the upper left corner, and the
/// swapchain is suboptimal while the sizes differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scaling {
    pub behavior: vk::PresentScalingFlagsEXT,
    pub gravity: [vk::PresentGravityFlagsEXT; 2],
}

impl Scaling {
    /// The supported behaviors.
    pub const BEHAVIORS: vk::PresentScalingFlagsEXT = vk::PresentScalingFlagsEXT::from_raw(
        vk::PresentScalingFlagsEXT::ONE_TO_ONE.as_raw()
            | vk::PresentScalingFlagsEXT::ASPECT_RATIO_STRETCH.as_raw()
            | vk::PresentScalingFlagsEXT::STRETCH.as_raw(),
    );
    /// The supported gravities, on either axis.
    pub const GRAVITIES: vk::PresentGravityFlagsEXT = vk::PresentGravityFlagsEXT::from_raw(
        vk::PresentGravityFlagsEXT::MIN.as_raw()
            | vk::PresentGravityFlagsEXT::MAX.as_raw()
            | vk::PresentGravityFlagsEXT::CENTERED.as_raw(),
    );

    /// Whether the application asked for scaling, so that a window of another size is not
    /// suboptimal.
    pub fn is_asked_for(&self) -> bool {
        !self.behavior.is_empty()
    }

    /// The placement of an image on a window.
    pub fn placement(&self, picture: vk::Extent2D, window: vk::Extent2D) -> Placement {
        let whole = |extent| vk::Rect2D {
            offset: vk::Offset2D::default(),
            extent,
        };
        match self.behavior {
            vk::PresentScalingFlagsEXT::STRETCH => Placement {
                from: whole(picture),
                to: whole(window),
            },
            vk::PresentScalingFlagsEXT::ASPECT_RATIO_STRETCH => {
                let extent = fitted(picture, window);
                let to = vk::Rect2D {
                    offset: self.offset(extent, window),
                    extent,
                };
                Placement {
                    from: whole(picture),
                    to,
                }
            }
            vk::PresentScalingFlagsEXT::ONE_TO_ONE => {
                let Placement { from, .. } = Placement::one_to_one(picture, window);
                // On each axis, the visible part is as large as the image or as the window.
                Placement {
                    from: vk::Rect2D {
                        offset: self.offset(from.extent, picture),
                        ..from
                    },
                    to: vk::Rect2D {
                        offset: self.offset(from.extent, window),
                        ..from
                    },
                }
            }
            _ => Placement::one_to_one(picture, window),
        }
    }

    fn offset(&self, inner: vk::Extent2D, outer: vk::Extent2D) -> vk::Offset2D {
        let along = |gravity, inner: u32, outer: u32| {
            let room = (outer - inner) as i32;
            match gravity {
                vk::PresentGravityFlagsEXT::MAX => room,
                vk::PresentGravityFlagsEXT::CENTERED => room / 2,
                _ => 0,
            }
        };
        vk::Offset2D {
            x: along(self.gravity[0], inner.width, outer.width),
            y: along(self.gravity[1], inner.height, outer.height),
        }
    }
}

/// The largest extent with the image's aspect ratio that fits in the window.
fn fitted(picture: vk::Extent2D, window: vk::Extent2D) -> vk::Extent2D {
    let (pw, ph) = (u64::from(picture.width), u64::from(picture.height));
    let (ww, wh) = (u64::from(window.width), u64::from(window.height));
    if pw * wh <= ph * ww {
        vk::Extent2D {
            width: ((pw * wh / ph) as u32).max(1),
            height: window.height,
        }
    } else {
        vk::Extent2D {
            width: window.width,
            height: ((ph * ww / pw) as u32).max(1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extent(width: u32, height: u32) -> vk::Extent2D {
        vk::Extent2D { width, height }
    }

    #[test]
    fn shapes_are_kept_and_gravity_is_obeyed() {
        let scaling = Scaling {
            behavior: vk::PresentScalingFlagsEXT::ASPECT_RATIO_STRETCH,
            gravity: [
                vk::PresentGravityFlagsEXT::CENTERED,
                vk::PresentGravityFlagsEXT::MAX,
            ],
        };
        let wide = scaling.placement(extent(4, 2), extent(10, 10)).to;
        assert_eq!((wide.offset.x, wide.offset.y), (0, 5));
        assert_eq!(wide.extent, extent(10, 5));
        let tall = scaling.placement(extent(2, 4), extent(10, 10)).to;
        assert_eq!((tall.offset.x, tall.offset.y), (2, 0));
        assert_eq!(tall.extent, extent(5, 10));
    }

    #[test]
    fn one_to_one_cuts_on_the_side_away_from_gravity() {
        let scaling = Scaling {
            behavior: vk::PresentScalingFlagsEXT::ONE_TO_ONE,
            gravity: [
                vk::PresentGravityFlagsEXT::MAX,
                vk::PresentGravityFlagsEXT::CENTERED,
            ],
        };
        let Placement { from, to } = scaling.placement(extent(8, 2), extent(5, 4));
        assert_eq!((from.offset.x, from.offset.y), (3, 0));
        assert_eq!((to.offset.x, to.offset.y), (0, 1));
        assert_eq!((from.extent, to.extent), (extent(5, 2), extent(5, 2)));
    }
}
