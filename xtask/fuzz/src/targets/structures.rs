//! Structures in memory and serialized, with words changed: headers, references, nodes, leaves.

use ash::vk;
use fastrand::Rng;
use tuff_tests::Buffer;

use crate::case::{Case, wild};
use crate::world::World;

/// Changes a word, or two that belong together.
fn change(rng: &mut Rng, words: &mut [u32], addresses: &[u64]) {
    let length = words.len();
    let reach = [32.min(length), 80.min(length), length][rng.usize(0..3)];
    let at = rng.usize(0..reach.saturating_sub(1).max(1));
    match rng.u32(0..6) {
        0 => words[at] ^= 1 << rng.u32(0..32),
        1 => words[at] = wild(rng) as u32,
        2 => words[at] = words[rng.usize(0..length)],
        3 => words[at] = words[at].wrapping_add(rng.u32(0..5)).wrapping_sub(2),
        _ => {
            let word = match rng.bool() {
                true => wild(rng),
                false => addresses[rng.usize(0..addresses.len())].wrapping_add(rng.u64(0..3) * 256),
            };
            let at = at & !1;
            (words[at], words[(at + 1) % length]) = (word as u32, (word >> 32) as u32);
        }
    }
}

/// Addresses to which something may refer.
fn addresses(world: &World) -> [u64; 5] {
    let buffer = world.guarded[0].buffer;
    [
        world.levels[0].address,
        world.levels[1].address,
        buffer.address,
        buffer.address + buffer.size_bytes - 256,
        0,
    ]
}

pub fn run(world: &World, case: &Case) {
    let mut rng = case.common();
    let addresses = addresses(world);
    let level = rng.usize(0..2);
    let storage = world.levels[level].storage.expect("it is known");
    let mut bad = world.good[level].clone();
    for mut rng in case.steps() {
        change(&mut rng, &mut bad, &addresses);
    }
    let restore = Restore(storage, &world.good[level]);
    storage.write(0, &bad);
    world.query(world.levels[1].address, [0, 2, 4][rng.usize(0..3)]);
    match rng.u32(0..4) {
        0 => world.trace(),
        1 => copy(world, level, &mut rng),
        2 => update(world, level),
        _ => {}
    }
    drop(restore);
}

/// Restores the original contents.
struct Restore<'a>(Buffer, &'a [u32]);

impl Drop for Restore<'_> {
    fn drop(&mut self) {
        self.0.write(0, self.1);
    }
}

/// Copies, serializes and asks.
fn copy(world: &World, level: usize, rng: &mut Rng) {
    let (gpu, source) = (&world.gpu, world.levels[level]);
    let kind = vk::AccelerationStructureTypeKHR::GENERIC;
    let target = gpu.empty_structure(kind, source.size_bytes);
    let mode = match rng.bool() {
        true => vk::CopyAccelerationStructureModeKHR::CLONE,
        false => vk::CopyAccelerationStructureModeKHR::COMPACT,
    };
    let info = vk::CopyAccelerationStructureInfoKHR::default()
        .src(source.handle)
        .dst(target.handle)
        .mode(mode);
    let room = gpu.buffer(source.size_bytes + 4096);
    let out = vk::CopyAccelerationStructureToMemoryInfoKHR::default()
        .src(source.handle)
        .dst(vk::DeviceOrHostAddressKHR {
            device_address: room.address.next_multiple_of(256),
        })
        .mode(vk::CopyAccelerationStructureModeKHR::SERIALIZE);
    // SAFETY: all live as long as the device; whatever they hold, the driver has to bear.
    world.run(|commands| unsafe {
        gpu.acceleration
            .cmd_copy_acceleration_structure(commands, &info);
        gpu.acceleration
            .cmd_copy_acceleration_structure_to_memory(commands, &out);
    });
    world.query(target.address, 0);
    let kinds = [
        vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
        vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR,
        vk::QueryType::ACCELERATION_STRUCTURE_SIZE_KHR,
    ];
    if gpu.has_host_commands {
        let mut words = [0u8; 8];
        for kind in kinds {
            // SAFETY: all live as long as the device; whatever they hold, the driver has to bear.
            let _ = unsafe {
                gpu.acceleration.write_acceleration_structures_properties(
                    &[source.handle],
                    kind,
                    &mut words,
                    8,
                )
            };
        }
    }
    gpu.destroy(target);
}

/// Updates in place, from geometry unrelated to the present one.
fn update(world: &World, level: usize) {
    super::builds::update_in_place(world, level);
}

pub fn run_serialized(world: &World, case: &Case) {
    let mut rng = case.common();
    let gpu = &world.gpu;
    let level = rng.usize(0..2);
    let source = world.levels[level];
    let buffer = gpu.buffer(2 * source.size_bytes + 4096);
    let address = buffer.address.next_multiple_of(256);
    let offset = (address - buffer.address) as usize;
    let out = vk::CopyAccelerationStructureToMemoryInfoKHR::default()
        .src(source.handle)
        .dst(vk::DeviceOrHostAddressKHR {
            device_address: address,
        })
        .mode(vk::CopyAccelerationStructureModeKHR::SERIALIZE);
    // SAFETY: the buffer is large enough.
    world.run(|commands| unsafe {
        gpu.acceleration
            .cmd_copy_acceleration_structure_to_memory(commands, &out);
    });
    let mut bad = buffer.read::<u32>()[offset / 4..].to_vec();
    let size_bytes = u64::from(bad[10]) | u64::from(bad[11]) << 32;
    let addresses = addresses(world);
    for mut rng in case.steps() {
        change(&mut rng, &mut bad[8..], &addresses);
    }
    buffer.write(offset, &bad);
    let kind = [
        vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
        vk::AccelerationStructureTypeKHR::TOP_LEVEL,
    ][level];
    let copy = gpu.empty_structure(kind, size_bytes);
    let info = vk::CopyMemoryToAccelerationStructureInfoKHR::default()
        .src(vk::DeviceOrHostAddressConstKHR {
            device_address: address,
        })
        .dst(copy.handle)
        .mode(vk::CopyAccelerationStructureModeKHR::DESERIALIZE);
    // SAFETY: the structure is as large as the head said; what it says now the driver has to bear.
    world.run(|commands| unsafe {
        gpu.acceleration
            .cmd_copy_memory_to_acceleration_structure(commands, &info);
    });
    world.query(copy.address, 0);
    let above = gpu.top(&[tuff_tests::Instance::of(copy)]);
    world.query(above.address, 2);
    gpu.destroy(above);
    gpu.destroy(copy);
}
