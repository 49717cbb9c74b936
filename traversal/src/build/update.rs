//! Updates: refit of a tree to new positions, while the tree still suits them.

use super::target::Target;
use super::{BuildError, Shape, refit};
use crate::input::{BuildFlags, BuildInput, Geometries};
use crate::layout::{Form, Header, Parts, micromap_part_bytes};
use crate::structure::Structure;

/// The factor by which updates may increase the cost of walks before a structure is rebuilt.
const WORN: f32 = 2.0;

/// Updates a structure: same geometries and primitive counts, new positions, transforms and
/// instances. `source` is the structure to start from; `None` updates `destination` in place.
///
/// Boxes are refitted to the new positions and the tree stays. If the expected cost of walks is
/// more than [`WORN`] times that of the original build, the structure is rebuilt, provided
/// `destination` and `scratch` have the sizes of [`build_sizes`](super::build_sizes) for a build.
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
    scratch: &mut [u8],
) -> Result<u64, BuildError> {
    let shape = Shape::of(&input.geometries)?;
    if !(destination.as_ptr() as usize).is_multiple_of(256) {
        return Err(BuildError::Destination);
    }
    if let Some(source) = source {
        let (structure, _) = Structure::of(source).map_err(|_| BuildError::Source)?;
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
    // Children must come after their parents, and leaves must name existing primitives.
    crate::structure::validate(destination).map_err(|_| BuildError::Source)?;
    let (structure, header) = Structure::of(destination).map_err(|_| BuildError::Source)?;
    if structure.kind() != shape.kind
        || structure.form() != Form::Groups
        || header.primitive_count != shape.primitives
        || u64::from(header.geometry_count) != shape.geometries
        || header.flags & BuildFlags::ALLOW_UPDATE == 0
        || !same_counts(&structure, &input.geometries)
        || (header.micromap_bytes > 0) != (shape.micromap_bytes > 0)
        || shape.kind.is_top() && u64::from(header.leaf_count) != shape.primitives
    {
        return Err(BuildError::Source);
    }
    let target = Target {
        base: destination.as_mut_ptr(),
        parts: Parts::new(
            shape.kind,
            Form::Groups,
            shape.geometries,
            header.node_count.into(),
            header.leaf_count.into(),
        ),
        kind: shape.kind,
        form: Form::Groups,
        geometries: &input.geometries,
    };
    let mut header = header;
    let (nodes, leaves) = (header.node_count, header.leaf_count);
    // SAFETY: the parts are inside the destination, and the memory of the input is readable by the
    // caller's promise.
    let refitted = unsafe {
        match &input.geometries {
            Geometries::Triangles(list) => refit::write_triangles(&target, leaves, list),
            Geometries::Aabbs(_) => {}
            Geometries::Swept(list) => refit::write_swept(&target, leaves, list),
            Geometries::Motion(list) => refit::write_motion(&target, leaves, list),
            Geometries::Instances(source) => {
                header.origin_error = refit::write_instances(&target, source);
            }
        }
        if shape.micromap_bytes > 0 {
            super::write_micromaps(&target, shape.micromap_bytes);
        }
        refit::refit(&target, nodes, leaves)
    };
    let worn = refitted.cost > WORN * header.cost;
    if worn && super::has_room(input, &shape, destination, scratch) {
        // SAFETY: the caller keeps the promises of `build`.
        return unsafe { super::build(input, destination, scratch) };
    }
    header.bounds = refitted.bounds;
    // SAFETY: the blob begins with its header.
    unsafe { target.base.cast::<Header>().write(header) };
    Ok(header.size_bytes)
}

/// Removes a structure's own micromaps, since the update names others.
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
    // SAFETY: long enough; a header is plain numbers.
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
