//! Serialized structures whose micromaps are listed: the application says where they are now.

use super::copies::motley;
use super::*;

/// A structure that is written to memory, and where.
struct Written {
    buffer: Buffer,
    address: u64,
    words: Vec<u64>,
}

fn write_out(gpu: &Gpu, structure: Structure) -> Written {
    let ty = vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR;
    // SAFETY: the structure is built, and the query reset.
    let size = gpu.query(ty, |commands, pool| unsafe {
        let structures = [structure.handle];
        (gpu.acceleration).cmd_write_acceleration_structures_properties(
            commands,
            &structures,
            ty,
            pool,
            0,
        );
    });
    let buffer = gpu.buffer(size.next_multiple_of(8) + 256);
    let address = buffer.address.next_multiple_of(256);
    let info = vk::CopyAccelerationStructureToMemoryInfoKHR::default()
        .src(structure.handle)
        .dst(vk::DeviceOrHostAddressKHR {
            device_address: address,
        })
        .mode(vk::CopyAccelerationStructureModeKHR::SERIALIZE);
    // SAFETY: all of it lives as long as the device.
    gpu.run(|commands| unsafe {
        (gpu.acceleration).cmd_copy_acceleration_structure_to_memory(commands, &info);
    });
    let bytes: Vec<u8> = buffer.read();
    let words = bytes[(address - buffer.address) as usize..].chunks_exact(8);
    let words: Vec<u64> = words
        .map(|word| u64::from_le_bytes(word.try_into().expect("eight bytes")))
        .collect();
    assert_eq!(words[4], size);
    Written {
        buffer,
        address,
        words,
    }
}

fn read_in(gpu: &Gpu, written: &Written) -> Structure {
    let copy = gpu.empty_structure(Level::BOTTOM_LEVEL, written.words[5]);
    let info = vk::CopyMemoryToAccelerationStructureInfoKHR::default()
        .src(vk::DeviceOrHostAddressConstKHR {
            device_address: written.address,
        })
        .dst(copy.handle)
        .mode(vk::CopyAccelerationStructureModeKHR::DESERIALIZE);
    // SAFETY: all of it lives as long as the device.
    gpu.run(|commands| unsafe {
        (gpu.acceleration).cmd_copy_memory_to_acceleration_structure(commands, &info);
    });
    copy
}

#[test]
fn addresses_of_micromaps_are_listed_and_rewritten() {
    let Some(gpu) = gpu_with_khr() else {
        return;
    };
    let (original, expected) = motley(&gpu, MicromapForm::Khr);
    // The other states: what was transparent is opaque, and the other way round.
    let state = |part: u32| (part.wrapping_mul(7) >> 1) as u8 & 3 ^ 1;
    let other = gpu.micromap_in(
        MicromapForm::Khr,
        &[MicroTriangle::of(2, FOUR_STATES, state)],
    );
    let flags = Flags::ALLOW_OPACITY_MICROMAP_UPDATE_EXT | Flags::ALLOW_UPDATE;
    let structure = bottom(&gpu, 1, &Use::of(&original), flags);
    let mut written = write_out(&gpu, structure);
    // Blocks, and how many: one or none for each geometry with a micromap.
    let [blocks, ty, count] = [written.words[6], written.words[7], written.words[8]];
    assert_eq!(blocks >> 32, 0xFFFF_FFFF);
    assert_eq!([blocks as u32, ty as u32], [1, 0]);
    assert!(count >= 1);
    let addresses = 9..9 + count as usize;
    let places: Vec<usize> = addresses.filter(|&i| written.words[i] != 0).collect();
    let [place] = places[..] else {
        panic!("one micromap: {places:?}");
    };
    assert_eq!(written.words[place], original.address);

    let found = |structure: Structure| {
        let world = gpu.top(&[Instance::of(structure)]);
        shoot(&gpu, world, &part_centres(2), 0)
    };
    assert_eq!(found(read_in(&gpu, &written)), expected);
    let start = (written.address - written.buffer.address) as usize;
    (written.buffer).write(start + 8 * place, &[other.address]);
    written.words[place] = other.address;
    let copy = read_in(&gpu, &written);
    let expected: Vec<u32> = (0..16).map(|part| outcome(state(part))).collect();
    assert_eq!(found(copy), expected);
    // Written again, it names the other.
    assert_eq!(write_out(&gpu, copy).words[place], other.address);
}

#[test]
fn structures_that_list_nothing_have_no_blocks() {
    let Some(gpu) = gpu_with_khr() else {
        return;
    };
    if !gpu.is_tuff() {
        return;
    }
    let (taken, expected) = motley(&gpu, MicromapForm::Ext);
    let structure = bottom(&gpu, 1, &Use::of(&taken), Flags::empty());
    let written = write_out(&gpu, structure);
    // The format is that of the device's extensions, whatever was built.
    assert_eq!(written.words[6], 0xFFFF_FFFF << 32);
    let world = gpu.top(&[Instance::of(read_in(&gpu, &written))]);
    assert_eq!(shoot(&gpu, world, &part_centres(2), 0), expected);
}

#[test]
fn losses_are_only_of_what_is_known() {
    let Some(gpu) = gpu_with_khr() else {
        return;
    };
    let state = |part: u32| (part.wrapping_mul(7) >> 1) as u8 & 3;
    let parts = gpu.micromap_parts(&[MicroTriangle::of(2, FOUR_STATES, state)]);
    let flags = BUILD_ACCELERATION_STRUCTURE_MICROMAP_LOSSY_BIT_KHR;
    let lossy = gpu.structure_micromap(parts, flags);
    let structure = bottom(&gpu, 1, &Use::of(&lossy), Flags::empty());
    let world = gpu.top(&[Instance::of(structure)]);
    let found = shoot(&gpu, world, &part_centres(2), 0);
    for (part, &found) in (0..).zip(&found) {
        assert!(found == outcome(state(part)) || found == ASKED, "{part}");
    }
}

#[test]
fn one_command_builds_micromaps_and_levels() {
    let Some(gpu) = gpu_with_khr() else {
        return;
    };
    let state = |part: u32| (part.wrapping_mul(5) >> 1) as u8 & 3;
    let parts = gpu.micromap_parts(&[MicroTriangle::of(2, FOUR_STATES, state)]);
    let data = parts.geometry_data();
    let mut micro = vk::AccelerationStructureGeometryKHR::default();
    micro.geometry_type = GEOMETRY_TYPE_MICROMAP_KHR;
    micro.p_next = (&raw const data).cast();
    let triangle = geometry_of(triangles_at(gpu.buffer_with(&corners(1)).at(), 3));
    // Through pointers, the other way to name geometries.
    let geometries = [[&micro], [&triangle]];
    let micromap = gpu.room_for_structure(4096);
    let plain = gpu.empty_structure(Level::BOTTOM_LEVEL, 1 << 16);
    let scratch = gpu.buffer(1 << 18).address.next_multiple_of(256);
    let info = |i: usize, ty: Level, destination: vk::AccelerationStructureKHR| {
        let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(ty)
            .dst_acceleration_structure(destination)
            .geometries_ptrs(&geometries[i]);
        info.scratch_data.device_address = scratch + ((i as u64) << 16);
        info
    };
    let infos = [
        info(
            0,
            ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR,
            micromap.structure,
        ),
        info(1, Level::BOTTOM_LEVEL, plain.handle),
    ];
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(1);
    let ranges = [std::ptr::null(), &raw const range];
    gpu.run(|commands| {
        let build = gpu.acceleration.fp().cmd_build_acceleration_structures_khr;
        // SAFETY: all that the infos refer to lives as long as the device, and no ranges go with a
        // micromap.
        unsafe { build(commands, 2, infos.as_ptr(), ranges.as_ptr()) };
    });
    let mapped = bottom(&gpu, 1, &Use::of(&micromap), Flags::empty());
    let centres = part_centres(2);
    let found = |structure| shoot(&gpu, gpu.top(&[Instance::of(structure)]), &centres, 0);
    let expected: Vec<u32> = (0..16).map(|part| outcome(state(part))).collect();
    assert_eq!(found(mapped), expected);
    assert_eq!(found(plain), [ASKED; 16]);
}

#[test]
fn a_micromap_is_no_level() {
    let Some(gpu) = gpu_with_khr() else {
        return;
    };
    if !gpu.is_tuff() {
        return;
    }
    // Not valid, and harmless: rays miss a micromap where a structure should be, and a structure in
    // a micromap's place asks everywhere.
    let (micromap, _) = motley(&gpu, MicromapForm::Khr);
    let as_structure = Structure {
        handle: micromap.structure,
        address: micromap.address,
        size_bytes: micromap.size_bytes,
        storage: None,
    };
    let centres = part_centres(2);
    assert_eq!(shoot(&gpu, as_structure, &centres, 0), [MISSED; 16]);
    let world = gpu.top(&[Instance::of(as_structure)]);
    assert_eq!(shoot(&gpu, world, &centres, 0), [MISSED; 16]);
    let structure = bottom(&gpu, 1, &Use::of(&micromap), Flags::empty());
    let wrong = Micromap {
        structure: structure.handle,
        ..micromap.clone()
    };
    let structure = bottom(&gpu, 1, &Use::of(&wrong), Flags::empty());
    let world = gpu.top(&[Instance::of(structure)]);
    assert_eq!(shoot(&gpu, world, &centres, 0), [ASKED; 16]);
}
