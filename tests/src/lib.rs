//! Black-box tests of a Vulkan driver through the Vulkan loader.
