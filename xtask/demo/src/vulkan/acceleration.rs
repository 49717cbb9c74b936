//! Building acceleration structures.

use anyhow::Result;
use ash::vk;

use super::{Buffer, Context};

/// A built acceleration structure and the buffer it lies in.
pub struct AccelerationStructure<'a> {
    context: &'a Context,
    pub handle: vk::AccelerationStructureKHR,
    _buffer: Buffer<'a>,
}

impl AccelerationStructure<'_> {
    /// The address that instances refer to.
    pub fn address(&self) -> u64 {
        let info = vk::AccelerationStructureDeviceAddressInfoKHR::default()
            .acceleration_structure(self.handle);
        // SAFETY: the handle is of this device.
        unsafe {
            self.context
                .acceleration
                .get_acceleration_structure_device_address(&info)
        }
    }
}

impl Drop for AccelerationStructure<'_> {
    fn drop(&mut self) {
        // SAFETY: the device is idle when structures go.
        unsafe {
            self.context
                .acceleration
                .destroy_acceleration_structure(self.handle, None)
        };
    }
}

/// The geometries of one bottom-level structure, each with its number of primitives and the index
/// that it adds to its vertices.
pub struct BlasInput<'g> {
    pub geometries: Vec<vk::AccelerationStructureGeometryKHR<'g>>,
    pub ranges: Vec<vk::AccelerationStructureBuildRangeInfoKHR>,
}

/// Builds bottom-level structures, all in one command.
pub fn build_blas<'a>(
    context: &'a Context,
    inputs: &[BlasInput],
) -> Result<Vec<AccelerationStructure<'a>>> {
    build(
        context,
        vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
        inputs,
    )
}

/// Builds the top-level structure over instances.
pub fn build_tlas<'a>(
    context: &'a Context,
    instances: &[vk::AccelerationStructureInstanceKHR],
) -> Result<AccelerationStructure<'a>> {
    // SAFETY: the structure is plain data of 64 bytes without padding.
    let bytes = unsafe {
        std::slice::from_raw_parts(instances.as_ptr().cast::<u8>(), size_of_val(instances))
    };
    let usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;
    let buffer = Buffer::with(context, bytes, usage)?;
    let data = vk::AccelerationStructureGeometryInstancesDataKHR::default().data(
        vk::DeviceOrHostAddressConstKHR {
            device_address: buffer.address(),
        },
    );
    let geometry = vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::INSTANCES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data });
    let count = instances.len() as u32;
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
    let input = BlasInput {
        geometries: vec![geometry],
        ranges: vec![range],
    };
    let mut built = build(
        context,
        vk::AccelerationStructureTypeKHR::TOP_LEVEL,
        &[input],
    )?;
    Ok(built.remove(0))
}

/// A structure that is not yet built, and the size of its scratch memory.
fn create<'a>(
    context: &'a Context,
    level: vk::AccelerationStructureTypeKHR,
    input: &BlasInput,
    info: &vk::AccelerationStructureBuildGeometryInfoKHR,
) -> Result<(AccelerationStructure<'a>, u64)> {
    let counts: Vec<u32> = input
        .ranges
        .iter()
        .map(|range| range.primitive_count)
        .collect();
    let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
    // SAFETY: there is one count for each geometry.
    unsafe {
        context.acceleration.get_acceleration_structure_build_sizes(
            vk::AccelerationStructureBuildTypeKHR::DEVICE,
            info,
            &counts,
            &mut sizes,
        );
    }
    let buffer = Buffer::new(
        context,
        sizes.acceleration_structure_size,
        vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR,
    )?;
    let create = vk::AccelerationStructureCreateInfoKHR::default()
        .buffer(buffer.handle)
        .size(sizes.acceleration_structure_size)
        .ty(level);
    // SAFETY: the buffer is as large as the structure, and lives beside it.
    let handle = unsafe {
        context
            .acceleration
            .create_acceleration_structure(&create, None)
    }?;
    let structure = AccelerationStructure {
        context,
        handle,
        _buffer: buffer,
    };
    Ok((structure, sizes.build_scratch_size))
}

fn build<'a>(
    context: &'a Context,
    level: vk::AccelerationStructureTypeKHR,
    inputs: &[BlasInput],
) -> Result<Vec<AccelerationStructure<'a>>> {
    let mut infos = Vec::new();
    let mut structures = Vec::new();
    let mut scratch_offsets = Vec::new();
    let mut scratch_size = 0;
    let alignment = u64::from(context.scratch_alignment.max(1));
    for input in inputs {
        let info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(level)
            .flags(vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE)
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(&input.geometries);
        let (structure, scratch_bytes) = create(context, level, input, &info)?;
        infos.push(info.dst_acceleration_structure(structure.handle));
        structures.push(structure);
        scratch_offsets.push(scratch_size);
        scratch_size += scratch_bytes.next_multiple_of(alignment);
    }
    let scratch = Buffer::new(
        context,
        scratch_size + alignment,
        vk::BufferUsageFlags::STORAGE_BUFFER,
    )?;
    let base = scratch.address().next_multiple_of(alignment);
    for (info, offset) in infos.iter_mut().zip(&scratch_offsets) {
        info.scratch_data.device_address = base + offset;
    }
    let ranges: Vec<&[vk::AccelerationStructureBuildRangeInfoKHR]> =
        inputs.iter().map(|input| &input.ranges[..]).collect();
    context.run(|commands| {
        let done = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::ACCELERATION_STRUCTURE_WRITE_KHR)
            .dst_access_mask(vk::AccessFlags::ACCELERATION_STRUCTURE_READ_KHR);
        // SAFETY: everything that the infos refer to outlives the submission.
        unsafe {
            context
                .acceleration
                .cmd_build_acceleration_structures(commands, &infos, &ranges);
            context.device.cmd_pipeline_barrier(
                commands,
                vk::PipelineStageFlags::ACCELERATION_STRUCTURE_BUILD_KHR,
                vk::PipelineStageFlags::ALL_COMMANDS,
                vk::DependencyFlags::empty(),
                &[done],
                &[],
                &[],
            );
        }
    })?;
    Ok(structures)
}
