//! A binding table as a command has read it.

use spirv_jit::program::Stage;

use super::recorder::{Lookups, RecordUse};
use crate::wave::binding_table::{
    Group, GroupKind, HANDLE_SIZE, Handle, Live, Region, Shaders, Tables,
};
use crate::wave::observer::TableKind;

/// Records of a region that are listed, at most, besides those that were looked up.
const MAX_RECORDS: u32 = 1024;
/// Bytes of a region that are searched for handles between its records, at most.
const MAX_SEARCHED: usize = 1 << 20;
/// Handles between records that are listed, at most.
const MAX_BETWEEN: usize = 16;

/// A region of the table.
#[derive(Debug)]
pub struct ReadRegion {
    pub kind: TableKind,
    /// As the command gives it.
    pub region: Region,
    /// Bytes of it that are memory.
    pub live_bytes: u64,
    /// Records that lie inside.
    pub record_count: u64,
    pub records: Vec<ReadRecord>,
    /// Indices past the end that were looked up.
    pub outside: Vec<(u32, RecordUse)>,
    /// Offsets of handles of the pipeline's groups where no record begins, and the groups.
    pub between: Vec<(u64, u32)>,
}

/// A record.
#[derive(Debug)]
pub struct ReadRecord {
    pub index: u32,
    pub address: u64,
    pub handle: Handle,
    /// The group that the handle names.
    pub group: Option<u32>,
    pub use_count: RecordUse,
    /// The group cannot be called from this region.
    pub misplaced: bool,
}

impl ReadRecord {
    /// The handle is all zero: the group is unused.
    pub fn is_zero(&self) -> bool {
        self.handle == [0; HANDLE_SIZE]
    }
}

/// Reads the regions of a table; `launched`: invocations of the command.
pub fn read(
    given: &Tables,
    live: &Tables<Live>,
    shaders: &Shaders,
    lookups: &Lookups,
    launched: u64,
) -> Vec<ReadRegion> {
    let regions = [
        (TableKind::RayGeneration, &given.raygen, &live.raygen),
        (TableKind::Miss, &given.miss, &live.miss),
        (TableKind::Hit, &given.hit, &live.hit),
        (TableKind::Callable, &given.callable, &live.callable),
    ];
    let read = regions.map(|(kind, given, live)| {
        let mut lookups: Vec<(u32, RecordUse)> = (lookups.iter())
            .filter(|((table, _), _)| *table == kind)
            .map(|((_, index), use_count)| (*index, *use_count))
            .collect();
        if kind == TableKind::RayGeneration {
            let (candidates, calls) = (0, launched);
            lookups = vec![(0, RecordUse { candidates, calls })];
        }
        read_region(kind, given, live, shaders, &lookups)
    });
    Vec::from(read)
}

fn read_region(
    kind: TableKind,
    given: &Region,
    live: &Live,
    shaders: &Shaders,
    lookups: &[(u32, RecordUse)],
) -> ReadRegion {
    let record_count = match kind {
        TableKind::RayGeneration => given.record_count().min(1),
        _ => given.record_count(),
    };
    let is_inside = |index: u32| u64::from(index) < record_count;
    let use_of = |index: u32| {
        let found = lookups.iter().filter(|(other, _)| *other == index);
        found.map(|(_, used)| *used).next().unwrap_or_default()
    };
    let mut indices: Vec<u32> = (0..MAX_RECORDS).filter(|&index| is_inside(index)).collect();
    let others = lookups.iter().map(|(index, _)| *index);
    indices.extend(others.filter(|&index| index >= MAX_RECORDS && is_inside(index)));
    // With a stride of 0 every index is the first record.
    let outside = (lookups.iter().copied())
        .filter(|&(index, _)| !is_inside(index) && (given.stride_bytes > 0 || record_count == 0));
    let records = indices.iter().filter_map(|&index| {
        let (address, handle) = live.handle(index)?;
        let group = shaders.group_index(&handle);
        let misplaced = group.is_some_and(|group| {
            let group = &shaders.groups[group as usize];
            !belongs(kind, group, shaders)
        });
        let mut use_count = use_of(index);
        if given.stride_bytes == 0 && kind != TableKind::RayGeneration {
            use_count = lookups
                .iter()
                .fold(RecordUse::default(), |sum, (_, one)| RecordUse {
                    candidates: sum.candidates + one.candidates,
                    calls: sum.calls + one.calls,
                });
        }
        Some(ReadRecord {
            index,
            address,
            handle,
            group,
            use_count,
            misplaced,
        })
    });
    ReadRegion {
        kind,
        region: *given,
        live_bytes: live.region().size_bytes,
        record_count,
        records: records.collect(),
        outside: outside.collect(),
        between: handles_between(kind, live, shaders),
    }
}

/// Whether a group can be called from a region.
fn belongs(kind: TableKind, group: &Group, shaders: &Shaders) -> bool {
    let stage = |program: u32| shaders.programs[program as usize].stage();
    let general = group.general.map(stage);
    match kind {
        TableKind::RayGeneration => general == Some(Stage::RayGeneration),
        TableKind::Miss => general == Some(Stage::Miss),
        TableKind::Callable => general == Some(Stage::Callable),
        TableKind::Hit => group.kind != GroupKind::General,
    }
}

/// Handles of the pipeline's groups where the stride puts no record: signs of a wrong stride.
fn handles_between(kind: TableKind, live: &Live, shaders: &Shaders) -> Vec<(u64, u32)> {
    let mut found = Vec::new();
    if kind == TableKind::RayGeneration {
        return found;
    }
    let stride = live.region().stride_bytes;
    let bytes = live.bytes(MAX_SEARCHED);
    for (at, handle) in bytes.windows(HANDLE_SIZE).enumerate().step_by(4) {
        let offset = at as u64;
        if offset.checked_rem(stride).unwrap_or(offset) == 0 {
            continue;
        }
        let Ok(handle) = <&Handle>::try_from(handle) else {
            continue;
        };
        if let Some(group) = shaders.group_index(handle) {
            found.push((offset, group));
            if found.len() == MAX_BETWEEN {
                break;
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use spirv_jit::reach::Reach;

    /// Handles of three groups, and one of none, 32 bytes apart.
    const HANDLES: [Handle; 4] = [
        [1; HANDLE_SIZE],
        [2; HANDLE_SIZE],
        [9; HANDLE_SIZE],
        [0; 32],
    ];

    fn shaders() -> Shaders {
        let groups = [1, 2, 3].map(|byte| Group {
            handle: [byte; HANDLE_SIZE],
            kind: GroupKind::Triangles,
            ..Group::default()
        });
        Shaders::new(Vec::new(), groups.into())
    }

    fn read_hit_region(stride_bytes: u64, size_bytes: u64, lookups: &Lookups) -> ReadRegion {
        let given = Tables {
            hit: Region {
                address: HANDLES.as_ptr().expose_provenance() as u64,
                stride_bytes,
                size_bytes,
            },
            ..Tables::default()
        };
        // SAFETY: the handles are constants of the program.
        let live = unsafe { given.live(&Reach::everywhere()) };
        let mut all = read(&given, &live, &shaders(), lookups, 7);
        all.swap_remove(2)
    }

    fn looked_up(index: u32, calls: u64) -> ((TableKind, u32), RecordUse) {
        let candidates = 2 * calls;
        ((TableKind::Hit, index), RecordUse { candidates, calls })
    }

    #[test]
    fn records_have_their_groups_and_uses() {
        let lookups = Lookups::from([looked_up(1, 5), looked_up(6, 3)]);
        let region = read_hit_region(32, 128, &lookups);
        let records: Vec<_> = (region.records.iter())
            .map(|it| (it.index, it.group, it.is_zero(), it.use_count.calls))
            .collect();
        assert_eq!(
            records,
            [
                (0, Some(0), false, 0),
                (1, Some(1), false, 5),
                (2, None, false, 0),
                (3, None, true, 0)
            ]
        );
        let outside: Vec<_> = (region.outside.iter())
            .map(|(index, used)| (*index, used.candidates))
            .collect();
        assert_eq!((outside, region.between), (vec![(6, 6)], vec![]));
    }

    #[test]
    fn handles_between_records_show_a_stride_that_is_too_long() {
        let lookups = Lookups::from([looked_up(1, 1)]);
        let region = read_hit_region(64, 64, &lookups);
        assert_eq!((region.record_count, region.outside.len()), (1, 1));
        assert_eq!(region.between, [(32, 1)]);
    }

    #[test]
    fn without_a_stride_all_indices_are_the_first_record() {
        let lookups = Lookups::from([looked_up(0, 1), looked_up(8, 4)]);
        let region = read_hit_region(0, 32, &lookups);
        assert_eq!((region.records.len(), region.outside.len()), (1, 0));
        assert_eq!(region.records[0].use_count.calls, 5);
    }

    #[test]
    fn no_region_has_no_records() {
        let region = read_hit_region(32, 0, &Lookups::new());
        assert_eq!((region.record_count, region.records.len()), (0, 0));
        let nowhere = Tables::default();
        // SAFETY: there is nothing.
        let live = unsafe { nowhere.live(&Reach::everywhere()) };
        let all = read(&nowhere, &live, &shaders(), &Lookups::new(), 0);
        assert!(
            all.iter()
                .all(|it| it.records.is_empty() && it.between.is_empty())
        );
    }
}
