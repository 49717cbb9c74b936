//! Acceleration structures for ray tracing on the CPU: build, lay out, intersect, walk.
