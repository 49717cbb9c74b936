//! A camera that flies: the mouse turns it, keys move it.
#![forbid(unsafe_code)]

use demo::scene::Camera;
use glam::{Quat, Vec3};
use winit::keyboard::KeyCode;

/// Keys that move the camera while they are held, and where to: right, up, forward.
const WAYS: [(KeyCode, Vec3); 10] = [
    (KeyCode::KeyD, Vec3::X),
    (KeyCode::KeyA, Vec3::NEG_X),
    (KeyCode::KeyE, Vec3::Y),
    (KeyCode::KeyQ, Vec3::NEG_Y),
    (KeyCode::KeyW, Vec3::Z),
    (KeyCode::KeyS, Vec3::NEG_Z),
    (KeyCode::ArrowRight, Vec3::X),
    (KeyCode::ArrowLeft, Vec3::NEG_X),
    (KeyCode::ArrowUp, Vec3::Z),
    (KeyCode::ArrowDown, Vec3::NEG_Z),
];

/// The part of the scene's extent that one second takes it.
const SPEED: f32 = 0.1;
/// As many times as fast with the shift key.
const HASTE: f32 = 5.0;
/// How near to straight up and down one can look: the sine of the angle that is left.
const STEEPEST: f32 = 0.02;

/// Keys that are held, and what they and the mouse do.
#[derive(Default)]
pub struct Flight {
    held: Vec<KeyCode>,
    pub hastens: bool,
}

impl Flight {
    pub fn key(&mut self, key: KeyCode, is_pressed: bool) {
        self.held.retain(|held| *held != key);
        if is_pressed && WAYS.iter().any(|(way, _)| *way == key) {
            self.held.push(key);
        }
    }

    /// Lets go of all keys: the window no longer hears of them.
    pub fn let_go(&mut self) {
        self.held.clear();
        self.hastens = false;
    }

    pub fn is_moving(&self) -> bool {
        !self.held.is_empty()
    }

    /// Moves the camera by what the keys say for some seconds.
    pub fn move_on(&self, camera: &mut Camera, extent: f32, seconds: f32) {
        let ways = WAYS.iter().filter(|(key, _)| self.held.contains(key));
        let way: Vec3 = ways.map(|(_, way)| *way).sum();
        if way == Vec3::ZERO {
            return;
        }
        let haste = if self.hastens { HASTE } else { 1.0 };
        let forward = camera.forward.normalize();
        let right = forward.cross(camera.up).normalize();
        let up = camera.up.normalize();
        let step = right * way.x + up * way.y + forward * way.z;
        camera.position += step * (extent * SPEED * haste * seconds);
    }
}

/// Turns the camera as if the picture were dragged: by pixels to the right and down, in a picture
/// of `height` pixels.
pub fn turn(camera: &mut Camera, (right, down): (f32, f32), height: u32) {
    let angle = camera.fov_y / height.max(1) as f32;
    let up = camera.up.normalize();
    let forward = Quat::from_axis_angle(up, right * angle) * camera.forward.normalize();
    let aside = forward.cross(up).normalize();
    let tilted = Quat::from_axis_angle(aside, down * angle) * forward;
    camera.forward = match tilted.cross(up).dot(aside) > STEEPEST {
        true => tilted,
        false => forward,
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            position: Vec3::ZERO,
            forward: Vec3::NEG_Z,
            up: Vec3::Y,
            fov_y: 1.0,
        }
    }

    #[test]
    fn keys_move_along_the_view() {
        let mut flight = Flight::default();
        flight.key(KeyCode::KeyW, true);
        flight.key(KeyCode::KeyD, true);
        flight.key(KeyCode::KeyD, false);
        let mut seen = camera();
        flight.move_on(&mut seen, 10.0, 2.0);
        assert_eq!(seen.position, Vec3::new(0.0, 0.0, -2.0));
        flight.let_go();
        assert!(!flight.is_moving());
    }

    #[test]
    fn the_picture_follows_the_mouse_and_never_turns_over() {
        let mut seen = camera();
        // The picture moves to the right with the mouse: the camera turns to the left.
        turn(&mut seen, (100.0, 0.0), 200);
        assert!(seen.forward.x < -0.4 && seen.forward.y.abs() < 1e-6);
        for _ in 0..100 {
            turn(&mut seen, (0.0, 100.0), 200);
        }
        assert!(seen.forward.y > 0.8 && seen.forward.y < 1.0);
        assert!((seen.forward.length() - 1.0).abs() < 1e-4);
    }
}
