//! Updates: the same tree over new positions.

use super::emit::{Target, triangle_word};
use super::motion::motion_bounds;
use super::swept::SweptPrimitive;
use super::{BuildError, Shape, instance, primitive};
use crate::input::{
    BuildFlags, BuildInput, Geometries, InstanceSource, MotionGeometry, SweptGeometry,
    TriangleGeometry,
};
use crate::layout::{
    Bounds, GROUP, Header, MotionEntry, Node, Parts, SweptEntry, TriangleGroup, child,
    geometry_word, micromap_part_bytes,
};
use crate::structure::Structure;

/// Updates a structure: same geometries and primitive counts, new positions, transforms and
/// instances. `source` is the structure to start from; `None` updates `destination` in place.
///
/// Boxes are refitted around the new positions and the tree stays: a structure that was updated
/// far away from what it was built for is right, but slower than a new one.
///
/// # Safety
/// As for [`build`](super::build).
///
/// # Errors
/// See [`BuildError`]; [`BuildError::Source`] if `source` does not fit `input`.
pub unsafe fn update(
    input: &BuildInput<'_>,
    source: Option<&[u8]>,
    destination: &mut [u8],
    _scratch: &mut [u8],
) -> Result<u64, BuildError> {
    let shape = Shape::of(&input.geometries)?;
    if !(destination.as_ptr() as usize).is_multiple_of(256) {
        return Err(BuildError::Destination);
    }
    if let Some(source) = source {
        let structure = Structure::of(source).map_err(|_| BuildError::Source)?;
        let own = structure
            .micromap_bytes()
            .saturating_sub(shape.micromap_bytes);
        let size = (structure.size_bytes() - own) as usize;
        destination
            .get_mut(..size)
            .ok_or(BuildError::Destination)?
            .copy_from_slice(&source[..size]);
    }
    if shape.micromap_bytes > 0 {
        leave_micromaps(destination)?;
    }
    // Children have to come after their parents, and leaves to name primitives that there are.
    crate::structure::validate(destination).map_err(|_| BuildError::Source)?;
    let structure = Structure::of(destination).map_err(|_| BuildError::Source)?;
    let header = *structure.header();
    if structure.kind() != shape.kind
        || header.primitive_count != shape.primitives
        || u64::from(header.geometry_count) != shape.geometries
        || header.flags & BuildFlags::ALLOW_UPDATE == 0
        || !same_counts(&structure, &input.geometries)
        || (header.micromap_bytes > 0) != (shape.micromap_bytes > 0)
    {
        return Err(BuildError::Source);
    }
    let target = Target {
        base: destination.as_mut_ptr(),
        parts: Parts::new(
            shape.kind,
            shape.geometries,
            header.node_count.into(),
            header.leaf_count.into(),
        ),
        kind: shape.kind,
        geometries: &input.geometries,
    };
    let mut header = header;
    // SAFETY: the parts are inside the destination, and the memory of the input is readable by the
    // caller's promise.
    unsafe {
        match &input.geometries {
            Geometries::Triangles(list) => write_triangles(&target, header.leaf_count, list),
            Geometries::Aabbs(_) => {}
            Geometries::Swept(list) => write_swept(&target, header.leaf_count, list),
            Geometries::Motion(list) => write_motion(&target, header.leaf_count, list),
            Geometries::Instances(source) => header.origin_error = write_instances(&target, source),
        }
        if shape.micromap_bytes > 0 {
            super::write_micromaps(&target, shape.micromap_bytes);
        }
        header.bounds = refit(&target, header.node_count);
        target.base.cast::<Header>().write(header);
    }
    Ok(header.size_bytes)
}

/// Makes a structure forget the micromaps that it holds itself: the update names others.
fn leave_micromaps(destination: &mut [u8]) -> Result<(), BuildError> {
    if destination.len() < size_of::<Header>() {
        return Err(BuildError::Source);
    }
    // SAFETY: long enough; a header is plain numbers.
    let mut header = unsafe { destination.as_ptr().cast::<Header>().read_unaligned() };
    let part = micromap_part_bytes(header.geometry_count.into(), header.primitive_count);
    let own = header.micromap_bytes.saturating_sub(part);
    if own == 0 {
        return Ok(());
    }
    header.micromap_bytes = part;
    header.size_bytes = header
        .size_bytes
        .checked_sub(own)
        .ok_or(BuildError::Source)?;
    let references = (header.size_bytes as usize)
        .checked_sub(part as usize)
        .and_then(|start| destination.get_mut(start..))
        .and_then(|part| part.get_mut(..8 * header.geometry_count as usize))
        .ok_or(BuildError::Source)?;
    references.fill(0);
    // SAFETY: as above.
    unsafe {
        destination
            .as_mut_ptr()
            .cast::<Header>()
            .write_unaligned(header)
    };
    Ok(())
}

fn same_counts(structure: &Structure, geometries: &Geometries<'_>) -> bool {
    let same = |counts: &mut dyn Iterator<Item = u32>| {
        counts.enumerate().all(|(i, count)| {
            structure
                .geometry(i as u32)
                .is_some_and(|entry| entry.primitive_count == count)
        })
    };
    match geometries {
        Geometries::Triangles(list) => same(&mut list.iter().map(|g| g.primitive_count)),
        Geometries::Aabbs(list) => same(&mut list.iter().map(|g| g.primitive_count)),
        Geometries::Swept(list) => same(&mut list.iter().map(|g| g.primitive_count)),
        Geometries::Motion(list) => same(&mut list.iter().map(|g| g.start.primitive_count)),
        Geometries::Instances(source) => same(&mut [source.count].into_iter()),
    }
}

/// Reads the positions of every triangle again.
///
/// # Safety
/// The target has `count` valid groups, and the geometries' memory is readable.
unsafe fn write_triangles(target: &Target<'_>, count: u32, list: &[TriangleGeometry]) {
    for index in 0..count {
        // SAFETY: one of the `count` groups.
        let group = unsafe { &mut *target.leaf_at::<TriangleGroup>(index) };
        for lane in 0..GROUP {
            if group.primitives[lane] == u32::MAX {
                continue;
            }
            let geometry = &list[(group.geometries[lane] & geometry_word::INDEX) as usize];
            group.geometries[lane] =
                triangle_word(group.geometries[lane] & geometry_word::INDEX, geometry);
            // SAFETY: the caller's promise.
            match unsafe { geometry.triangle(group.primitives[lane]) } {
                Some(triangle) => {
                    group.set_triangle(lane, &triangle);
                    group.lanes |= 1 << lane;
                }
                None => group.lanes &= !(1 << lane),
            }
        }
    }
}

/// Reads every sphere and swept sphere again.
///
/// # Safety
/// The target has `count` valid entries, and the geometries' memory is readable.
unsafe fn write_swept(target: &Target<'_>, count: u32, list: &[SweptGeometry]) {
    for index in 0..count {
        // SAFETY: one of the `count` entries.
        let entry = unsafe { &mut *target.leaf_at::<SweptEntry>(index) };
        let number = entry.geometry & geometry_word::INDEX;
        let geometry = &list[number as usize];
        // SAFETY: the caller's promise.
        let read = unsafe { geometry.primitive(entry.primitive) };
        *entry = read
            .unwrap_or(SweptPrimitive::NOTHING)
            .entry(entry.primitive, number, geometry);
    }
}

/// Reads every triangle that moves again.
///
/// # Safety
/// The target has `count` valid entries, and the geometries' memory is readable.
unsafe fn write_motion(target: &Target<'_>, count: u32, list: &[MotionGeometry]) {
    for index in 0..count {
        // SAFETY: one of the `count` entries, and the caller's promise.
        unsafe {
            let entry = &mut *target.leaf_at::<MotionEntry>(index);
            let number = entry.geometry & geometry_word::INDEX;
            *entry = list[number as usize].entry(entry.primitive, number);
        }
    }
}

/// Writes a record and a reference for each instance. Returns the largest error factor.
///
/// # Safety
/// The target has a record for each instance; the source's memory is readable and its references
/// are 0 or built bottom levels.
pub(crate) unsafe fn write_instances(target: &Target<'_>, source: &InstanceSource) -> f32 {
    let mut origin_error = 0f32;
    for index in 0..source.count {
        // SAFETY: the caller's promise.
        let instance = unsafe { instance::read(source, index) }.unwrap_or(instance::Instance {
            object_to_world: [0.0; 12],
            custom_index_and_mask: 0,
            sbt_offset_and_flags: 0,
            reference: 0,
            motion: None,
        });
        // SAFETY: the caller's promise.
        let placed = unsafe { instance.place() };
        if let Some(placed) = &placed {
            origin_error = origin_error.max(placed.origin_error);
        }
        // SAFETY: there is a record and a table entry for each instance.
        unsafe {
            let record = instance.record(placed.as_ref());
            match source.array.is_motion() {
                true => target.write_leaf(index, instance.motion_record(record)),
                false => target.write_leaf(index, record),
            }
            target
                .base
                .add(target.parts.references_offset as usize)
                .cast::<u64>()
                .add(index as usize)
                .write(instance.reference);
        }
    }
    origin_error
}

/// The box of a child's primitives as they are now.
///
/// # Safety
/// The leaf is valid and the geometries' memory is readable.
unsafe fn leaf_bounds(target: &Target<'_>, index: u32, groups: u32) -> Bounds {
    match target.geometries {
        Geometries::Triangles(_) => (index..index + groups)
            .map(|index| {
                // SAFETY: the caller's promise.
                let group = unsafe { &*target.leaf_at::<TriangleGroup>(index) };
                (0..GROUP)
                    .filter(|lane| group.lanes >> lane & 1 != 0)
                    .map(|lane| primitive::sanitized_triangle_bounds(&group.triangle(lane)))
                    .fold(Bounds::EMPTY, Bounds::union)
            })
            .fold(Bounds::EMPTY, Bounds::union),
        Geometries::Aabbs(list) => {
            // SAFETY: the caller's promise.
            let entry = unsafe { *target.leaf_at::<crate::layout::BoxEntry>(index) };
            let geometry = &list[(entry.geometry & geometry_word::INDEX) as usize];
            // SAFETY: the caller's promise.
            unsafe { primitive::aabb(geometry, entry.primitive) }.unwrap_or(Bounds::EMPTY)
        }
        Geometries::Swept(list) => {
            // SAFETY: the caller's promise.
            let entry = unsafe { *target.leaf_at::<SweptEntry>(index) };
            let geometry = &list[(entry.geometry & geometry_word::INDEX) as usize];
            // SAFETY: the caller's promise.
            unsafe { geometry.primitive(entry.primitive) }
                .map_or(Bounds::EMPTY, |primitive| primitive.bounds())
        }
        Geometries::Motion(list) => {
            // SAFETY: the caller's promise.
            let entry = unsafe { *target.leaf_at::<MotionEntry>(index) };
            let geometry = &list[(entry.geometry & geometry_word::INDEX) as usize];
            // SAFETY: the caller's promise.
            unsafe { geometry.triangles(entry.primitive) }
                .map_or(Bounds::EMPTY, |both| motion_bounds(&both))
        }
        Geometries::Instances(source) => {
            // SAFETY: the caller's promise.
            unsafe {
                instance::read(source, index)
                    .and_then(|instance| instance.place())
                    .map_or(Bounds::EMPTY, |placed| placed.bounds)
            }
        }
    }
}

/// Recomputes every box, children before parents. Returns the root's.
///
/// # Safety
/// The target has `count` valid nodes over valid leaves, and the geometries' memory is readable.
pub(crate) unsafe fn refit(target: &Target<'_>, count: u32) -> Bounds {
    let nodes = target
        .base
        .wrapping_add(target.parts.nodes_offset as usize)
        .cast::<Node>();
    let mut all = Bounds::EMPTY;
    for index in (0..count).rev() {
        // SAFETY: one of the `count` nodes; nobody else has them.
        let node = unsafe { &mut *nodes.add(index as usize) };
        for lane in 0..crate::layout::WIDTH {
            let word = node.children[lane];
            let bounds = if word == child::NONE {
                Bounds::EMPTY
            } else if word & child::LEAF != 0 {
                let groups = if word & child::TWO_GROUPS != 0 { 2 } else { 1 };
                // SAFETY: a valid child.
                unsafe { leaf_bounds(target, word & child::INDEX, groups) }
            } else {
                // SAFETY: a valid child is another node, above this one.
                unsafe { (*nodes.add(word as usize)).all_bounds() }
            };
            node.set_bounds(lane, bounds);
        }
        all = node.all_bounds();
    }
    all
}
