//! Three components, in f32 as meshes and rays have them.

pub type Vector = [f32; 3];

pub fn add(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

pub fn subtract(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

pub fn scale(a: Vector, factor: f32) -> Vector {
    a.map(|c| c * factor)
}

pub fn dot(a: Vector, b: Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub fn length(a: Vector) -> f32 {
    dot(a, a).sqrt()
}

pub fn normalize(a: Vector) -> Vector {
    scale(a, 1.0 / length(a))
}
