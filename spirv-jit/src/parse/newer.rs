//! Numbers of SPIR-V that the bindings lack.

/// Execution mode of `SPV_KHR_opacity_micromap`; its operand is a boolean constant.
pub const OPACITY_MICROMAP_ID: u32 = 6031;
/// Decoration of `SPV_KHR_constant_data` for text data. It changes no value.
pub const UTF_ENCODED: u32 = 5145;
/// `OpConstantDataKHR`, parsed as an `OpConstant` with as many words.
pub const CONSTANT_DATA: u32 = 5147;
/// `OpSpecConstantDataKHR`, parsed as an `OpSpecConstant`.
pub const SPEC_CONSTANT_DATA: u32 = 5148;

/// `OpAbortKHR`, parsed as an `OpTerminateInvocation` with two ids.
pub const ABORT: u32 = 5121;

macro_rules! capabilities {
    ($($(#[$doc:meta])* $name:ident = $number:literal;)*) => {
        /// Capabilities that the bindings lack.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum NewerCapability {
            $($(#[$doc])* $name = $number,)*
        }

        impl NewerCapability {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// The capability of a number.
            pub fn from_u32(number: u32) -> Option<Self> {
                match number {
                    $($number => Some(Self::$name),)*
                    _ => None,
                }
            }
        }
    };
}

capabilities! {
    /// `SPV_KHR_abort`.
    AbortKHR = 5120;
    /// `SPV_KHR_constant_data`.
    ConstantDataKHR = 5146;
    /// `SPV_KHR_opacity_micromap`.
    RayTracingOpacityMicromapExecutionModeKHR = 6032;
}
