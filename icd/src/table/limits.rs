//! The table of limits.

/// `maxRayDispatchInvocationCount`.
pub const MAX_RAY_DISPATCH_INVOCATIONS: u32 = 1 << 30;

/// The identifiers at the head of serialized acceleration structures: the driver's, and the layout's version.
pub fn serialization_uuids() -> [[u8; 16]; 2] {
    [*b"tuff vulkan cpu\0", *b"tuff structure 1"]
}
