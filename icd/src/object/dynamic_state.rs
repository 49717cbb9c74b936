//! The dynamic states of a pipeline (`VkPipelineDynamicStateCreateInfo`), and how binding a
//! pipeline makes its static state current.

#![forbid(unsafe_code)]

use ash::vk;

use super::graphics_state::{BlendAttachment, GraphicsState};

/// The parts of a graphics pipeline (`VkGraphicsPipelineLibraryFlagBitsEXT`).
pub type Parts = vk::GraphicsPipelineLibraryFlagsEXT;

/// The states that can be dynamic, each with its part of a pipeline.
#[rustfmt::skip]
const STATES: [(vk::DynamicState, Parts); 51] = {
    use vk::DynamicState as State;
    const INPUT: Parts = Parts::VERTEX_INPUT_INTERFACE;
    const BEFORE: Parts = Parts::PRE_RASTERIZATION_SHADERS;
    const FRAGMENT: Parts = Parts::FRAGMENT_SHADER;
    const SHADED: Parts = Parts::from_raw(BEFORE.as_raw() | FRAGMENT.as_raw());
    const OUTPUT: Parts = Parts::FRAGMENT_OUTPUT_INTERFACE;
    [
        (State::VERTEX_INPUT_EXT, INPUT),
        (State::VERTEX_INPUT_BINDING_STRIDE, INPUT),
        (State::PRIMITIVE_TOPOLOGY, INPUT),
        (State::PRIMITIVE_RESTART_ENABLE, INPUT),
        (State::PATCH_CONTROL_POINTS_EXT, BEFORE),
        (State::TESSELLATION_DOMAIN_ORIGIN_EXT, BEFORE),
        (State::VIEWPORT, BEFORE),
        (State::SCISSOR, BEFORE),
        (State::VIEWPORT_WITH_COUNT, BEFORE),
        (State::SCISSOR_WITH_COUNT, BEFORE),
        (State::LINE_WIDTH, BEFORE),
        (State::DEPTH_BIAS, BEFORE),
        (State::CULL_MODE, BEFORE),
        (State::FRONT_FACE, BEFORE),
        (State::RASTERIZER_DISCARD_ENABLE, BEFORE),
        (State::DEPTH_BIAS_ENABLE, BEFORE),
        (State::LINE_STIPPLE_KHR, BEFORE),
        (State::DEPTH_CLAMP_ENABLE_EXT, BEFORE),
        (State::POLYGON_MODE_EXT, BEFORE),
        (State::DEPTH_CLIP_ENABLE_EXT, BEFORE),
        (State::RASTERIZATION_STREAM_EXT, BEFORE),
        (State::PROVOKING_VERTEX_MODE_EXT, BEFORE),
        (State::LINE_RASTERIZATION_MODE_EXT, BEFORE),
        (State::LINE_STIPPLE_ENABLE_EXT, BEFORE),
        (State::DEPTH_CLIP_NEGATIVE_ONE_TO_ONE_EXT, BEFORE),
        (crate::ffi::vk::DYNAMIC_STATE_DEPTH_CLAMP_RANGE_EXT, BEFORE),
        (State::FRAGMENT_SHADING_RATE_KHR, SHADED),
        (State::DEPTH_BOUNDS, FRAGMENT),
        (State::STENCIL_COMPARE_MASK, FRAGMENT),
        (State::STENCIL_WRITE_MASK, FRAGMENT),
        (State::STENCIL_REFERENCE, FRAGMENT),
        (State::DEPTH_TEST_ENABLE, FRAGMENT),
        (State::DEPTH_WRITE_ENABLE, FRAGMENT),
        (State::DEPTH_COMPARE_OP, FRAGMENT),
        (State::DEPTH_BOUNDS_TEST_ENABLE, FRAGMENT),
        (State::STENCIL_TEST_ENABLE, FRAGMENT),
        (State::STENCIL_OP, FRAGMENT),
        (State::BLEND_CONSTANTS, OUTPUT),
        (State::LOGIC_OP_EXT, OUTPUT),
        (State::COLOR_WRITE_ENABLE_EXT, OUTPUT),
        (State::RASTERIZATION_SAMPLES_EXT, OUTPUT),
        (State::SAMPLE_MASK_EXT, OUTPUT),
        (State::SAMPLE_LOCATIONS_EXT, OUTPUT),
        (State::SAMPLE_LOCATIONS_ENABLE_EXT, OUTPUT),
        (State::ALPHA_TO_COVERAGE_ENABLE_EXT, OUTPUT),
        (State::ALPHA_TO_ONE_ENABLE_EXT, OUTPUT),
        (State::LOGIC_OP_ENABLE_EXT, OUTPUT),
        (State::COLOR_BLEND_ENABLE_EXT, OUTPUT),
        (State::COLOR_BLEND_EQUATION_EXT, OUTPUT),
        (State::COLOR_BLEND_ADVANCED_EXT, OUTPUT),
        (State::COLOR_WRITE_MASK_EXT, OUTPUT),
    ]
};

/// A set of states that commands set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DynamicStates(u64);

impl DynamicStates {
    /// The dynamic states of a pipeline with `parts`; states of other parts are ignored.
    pub fn of(states: &[vk::DynamicState], parts: Parts) -> Self {
        let counts = |&(state, part): &(vk::DynamicState, Parts)| {
            parts.intersects(part) && states.contains(&state)
        };
        let bits = (STATES.iter().enumerate()).filter(|(_, row)| counts(row));
        Self(bits.fold(0, |set, (bit, _)| set | 1 << bit))
    }

    /// The union, for linked parts.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub fn contains(self, state: vk::DynamicState) -> bool {
        let bit = STATES.iter().position(|&(known, _)| known == state);
        bit.is_some_and(|bit| self.0 >> bit & 1 != 0)
    }
}

impl GraphicsState {
    /// Copies the state of some parts of a pipeline, for a linked library.
    pub fn take_parts(&mut self, parts: Parts, from: &Self) {
        if parts.contains(Parts::VERTEX_INPUT_INTERFACE) {
            self.vertex_input = from.vertex_input.clone();
            self.topology = from.topology;
            self.primitive_restart = from.primitive_restart;
        }
        if parts.contains(Parts::PRE_RASTERIZATION_SHADERS) {
            self.viewports = from.viewports.clone();
            self.tessellation = from.tessellation;
            self.rasterization = from.rasterization;
        }
        if parts.intersects(Parts::PRE_RASTERIZATION_SHADERS | Parts::FRAGMENT_SHADER) {
            self.shading_rate = from.shading_rate;
        }
        if parts.contains(Parts::FRAGMENT_SHADER) {
            self.depth_stencil = from.depth_stencil;
        }
        if parts.contains(Parts::FRAGMENT_OUTPUT_INTERFACE) {
            self.multisample = from.multisample;
            self.blend = from.blend;
            self.color_locations = from.color_locations;
            self.used_attachments = from.used_attachments;
        }
    }

    /// Copies all static state of a pipeline, whose state is `from` (`vkCmdBindPipeline`).
    pub fn take_static(&mut self, from: &Self, dynamic: DynamicStates) {
        use vk::DynamicState as State;
        let mut new = from.clone();
        self.keep_in(&mut new, |state| dynamic.contains(state));
        // A static count stays, even if the values were set.
        if dynamic.contains(State::VIEWPORT) {
            new.viewports.viewports = self.viewports.viewports.clone();
        }
        if dynamic.contains(State::SCISSOR) {
            new.viewports.scissors = self.viewports.scissors.clone();
        }
        *self = new;
    }

    /// Writes the dynamic state into `new`, a pipeline's state.
    fn keep_in(&self, new: &mut Self, dynamic: impl Fn(vk::DynamicState) -> bool) {
        use vk::DynamicState as State;
        macro_rules! keep {
            ($($state:ident: $($field:ident).+ $(, $($more:ident).+)*;)*) => {
                $(if dynamic(State::$state) {
                    new.$($field).+.clone_from(&self.$($field).+);
                    $(new.$($more).+.clone_from(&self.$($more).+);)*
                })*
            };
        }
        keep! {
            VERTEX_INPUT_EXT: vertex_input;
            PRIMITIVE_TOPOLOGY: topology;
            PRIMITIVE_RESTART_ENABLE: primitive_restart;
            PATCH_CONTROL_POINTS_EXT: tessellation.control_points;
            TESSELLATION_DOMAIN_ORIGIN_EXT: tessellation.lower_left;
            VIEWPORT_WITH_COUNT: viewports.viewports;
            SCISSOR_WITH_COUNT: viewports.scissors;
            LINE_WIDTH: rasterization.line_width;
            DEPTH_BIAS: rasterization.depth_bias_constant, rasterization.depth_bias_clamp,
                rasterization.depth_bias_slope, rasterization.depth_bias_representation,
                rasterization.depth_bias_exact;
            CULL_MODE: rasterization.cull_mode;
            FRONT_FACE: rasterization.front_face;
            RASTERIZER_DISCARD_ENABLE: rasterization.discard;
            DEPTH_BIAS_ENABLE: rasterization.depth_bias;
            LINE_STIPPLE_KHR: rasterization.line_stipple_factor, rasterization.line_stipple_pattern;
            DEPTH_CLAMP_ENABLE_EXT: rasterization.depth_clamp;
            POLYGON_MODE_EXT: rasterization.polygon_mode;
            DEPTH_CLIP_ENABLE_EXT: rasterization.depth_clip, rasterization.depth_clip_follows;
            RASTERIZATION_STREAM_EXT: rasterization.stream;
            PROVOKING_VERTEX_MODE_EXT: rasterization.provoking_last;
            LINE_RASTERIZATION_MODE_EXT: rasterization.line_mode;
            LINE_STIPPLE_ENABLE_EXT: rasterization.line_stipple;
            DEPTH_CLIP_NEGATIVE_ONE_TO_ONE_EXT: rasterization.negative_one_to_one;
            FRAGMENT_SHADING_RATE_KHR: shading_rate;
            DEPTH_BOUNDS: depth_stencil.depth_bounds;
            DEPTH_TEST_ENABLE: depth_stencil.depth_test;
            DEPTH_WRITE_ENABLE: depth_stencil.depth_write;
            DEPTH_COMPARE_OP: depth_stencil.depth_compare;
            DEPTH_BOUNDS_TEST_ENABLE: depth_stencil.depth_bounds_test;
            STENCIL_TEST_ENABLE: depth_stencil.stencil_test;
            BLEND_CONSTANTS: blend.constants;
            LOGIC_OP_EXT: blend.set_logic_op;
            COLOR_WRITE_ENABLE_EXT: blend.write_enable;
            RASTERIZATION_SAMPLES_EXT: multisample.samples;
            SAMPLE_MASK_EXT: multisample.sample_mask;
            SAMPLE_LOCATIONS_EXT: multisample.locations;
            SAMPLE_LOCATIONS_ENABLE_EXT: multisample.has_locations;
            ALPHA_TO_COVERAGE_ENABLE_EXT: multisample.alpha_to_coverage;
            ALPHA_TO_ONE_ENABLE_EXT: multisample.alpha_to_one;
            LOGIC_OP_ENABLE_EXT: blend.logic_op;
        }
        if dynamic(crate::ffi::vk::DYNAMIC_STATE_DEPTH_CLAMP_RANGE_EXT) {
            new.rasterization.depth_clamp_range = self.rasterization.depth_clamp_range;
        }
        let rasterization = &mut new.rasterization;
        if rasterization.depth_clip_follows {
            rasterization.depth_clip = !rasterization.depth_clamp;
        }
        let op = new.blend.set_logic_op;
        new.blend.logic_op = new.blend.logic_op.map(|_| op);
        self.keep_stencil_in(new, &dynamic);
        self.keep_attachments_in(new, &dynamic);
    }

    /// Writes the dynamic state of both faces into `new`.
    fn keep_stencil_in(&self, new: &mut Self, dynamic: &impl Fn(vk::DynamicState) -> bool) {
        use vk::DynamicState as State;
        for (to, from) in (new.depth_stencil.stencil.iter_mut()).zip(&self.depth_stencil.stencil) {
            if dynamic(State::STENCIL_COMPARE_MASK) {
                to.compare_mask = from.compare_mask;
            }
            if dynamic(State::STENCIL_WRITE_MASK) {
                to.write_mask = from.write_mask;
            }
            if dynamic(State::STENCIL_REFERENCE) {
                to.reference = from.reference;
            }
            if dynamic(State::STENCIL_OP) {
                (to.fail, to.pass) = (from.fail, from.pass);
                (to.depth_fail, to.compare) = (from.depth_fail, from.compare);
            }
        }
    }

    /// Writes the dynamic state of the color attachments into `new`.
    fn keep_attachments_in(&self, new: &mut Self, dynamic: &impl Fn(vk::DynamicState) -> bool) {
        use vk::DynamicState as State;
        for (to, from) in (new.blend.attachments.iter_mut()).zip(&self.blend.attachments) {
            if dynamic(State::COLOR_BLEND_ENABLE_EXT) {
                to.enable = from.enable;
            }
            if dynamic(State::COLOR_WRITE_MASK_EXT) {
                to.write_mask = from.write_mask;
            }
            if dynamic(State::COLOR_BLEND_EQUATION_EXT) {
                *to = BlendAttachment {
                    enable: to.enable,
                    write_mask: to.write_mask,
                    advanced: to.advanced,
                    ..*from
                };
            }
            if dynamic(State::COLOR_BLEND_ADVANCED_EXT) {
                (to.color_op, to.alpha_op) = (from.color_op, from.alpha_op);
                to.advanced = from.advanced;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::DynamicState as State;

    #[test]
    fn binding_takes_what_is_static_and_keeps_what_is_dynamic() {
        let mut current = GraphicsState::default();
        current.rasterization.line_width = 3.0;
        current.depth_stencil.stencil[1].reference = 7;
        current.topology = vk::PrimitiveTopology::POINT_LIST;
        let mut pipeline = GraphicsState::default();
        pipeline.rasterization.line_width = 1.5;
        pipeline.rasterization.depth_bias = true;
        pipeline.topology = vk::PrimitiveTopology::LINE_LIST;
        let states = [
            State::LINE_WIDTH,
            State::STENCIL_REFERENCE,
            State::LOGIC_OP_EXT,
        ];
        let before = DynamicStates::of(&states, Parts::PRE_RASTERIZATION_SHADERS);
        assert!(before.contains(State::LINE_WIDTH));
        assert!(!before.contains(State::STENCIL_REFERENCE));
        let all = before.union(DynamicStates::of(&states, Parts::FRAGMENT_SHADER));
        current.take_static(&pipeline, all);
        assert_eq!(current.rasterization.line_width, 3.0);
        assert!(current.rasterization.depth_bias);
        assert_eq!(current.depth_stencil.stencil[1].reference, 7);
        assert_eq!(current.topology, vk::PrimitiveTopology::LINE_LIST);
    }

    #[test]
    fn clipping_follows_clamping_until_it_is_set() {
        let mut current = GraphicsState::default();
        current.rasterization.depth_clamp = true;
        let states = [State::DEPTH_CLAMP_ENABLE_EXT];
        let dynamic = DynamicStates::of(&states, Parts::PRE_RASTERIZATION_SHADERS);
        current.take_static(&GraphicsState::default(), dynamic);
        assert!(current.rasterization.depth_clamp && !current.rasterization.depth_clip);
    }
}
