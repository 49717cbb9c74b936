//! Ray queries: walks whose driver is the shader. A wave that proceeds suspends, its lanes' walks are advanced here, and it goes on at once;
//! no lane moves.
//!
//! The shader's side of a query is its object in per-lane memory (`spirv_jit::query`). This side, the walk, is kept only while it is
//! suspended at a candidate: opaque triangles never are.

use std::cell::OnceCell;

use spirv_jit::Program;
use spirv_jit::program::AlignedRow;
use spirv_jit::query::{QueryField, QueryWord, row, state};
use traversal::{Event, Hit, Ray, Structure, Swept, Verdict, Walk, Walker};

use super::hit_object::primitive_of;
use super::rays::to_object;
use super::slab::Slab;
use super::subgroup::lanes_of;
use super::{Limits, Stopped};

/// Fuel of a walk between two looks at the limits.
const FUEL: u64 = 1 << 16;

/// Suspended walks that a worker may keep, at most.
const MAX_SUSPENDED: usize = 1 << 20;

/// The suspended walks of a worker.
#[derive(Default)]
pub struct Queries {
    arena: Arena,
    /// Changes places with the walk that is taken up, so that its memory is used again.
    walk: Option<Walk>,
}

/// Walks that belong together: those of a subgroup or a workgroup, which end with it.
#[derive(Default)]
pub struct Owned(Vec<u32>);

#[derive(Default)]
struct Arena {
    suspended: Slab<Suspended>,
    count: usize,
}

#[derive(Default)]
struct Suspended {
    walk: Option<Walk>,
    /// Place in its owner's list; `None` if nobody's.
    place: Option<u32>,
    lane: u8,
}

impl Owned {
    /// Starts over; what was listed has been forgotten.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

impl Queries {
    /// Answers a `RayQueryProceed` at which a subgroup stands. Whatever memory the shader has spoilt, the answer is an answer.
    ///
    /// # Errors
    /// A limit was reached.
    pub fn proceed(
        &mut self,
        walker: &mut Walker,
        program: &Program,
        rows: &mut [AlignedRow],
        owned: &mut Owned,
        limits: &Limits,
    ) -> Result<(), Stopped> {
        let io = program.layout().io;
        let mask = program.event_mask(rows);
        let first = rows[io].0;
        let mut answers = [0; spirv_jit::SUBGROUP_SIZE];
        let words = program.query_words();
        let private = program.private_rows(rows);
        for lane in lanes_of(mask) {
            let object = (first[lane] as usize)..(first[lane] as usize + row::WORDS + words.len());
            let Some(object) = private.get_mut(object) else {
                continue;
            };
            let mut query = Object {
                rows: object,
                lane,
                program: program.number(),
            };
            answers[lane] = self.advance(walker, &mut query, words, owned, limits)? as u32;
        }
        for lane in lanes_of(mask) {
            rows[io].0[lane] = answers[lane];
        }
        Ok(())
    }

    /// Whether the query stands at a candidate now.
    fn advance(
        &mut self,
        walker: &mut Walker,
        query: &mut Object<'_>,
        words: &[QueryWord],
        owned: &mut Owned,
        limits: &Limits,
    ) -> Result<bool, Stopped> {
        let stands = query.word(row::STATE);
        let handle = query.word(row::HANDLE);
        let mut verdict = Verdict::Continue;
        match stands {
            state::READY => {
                self.arena.remove(handle, owned);
                query.set(row::HANDLE, 0);
                // An address that leads nowhere is none.
                let structure = limits.structure(query.structure());
                // SAFETY: the application keeps the structures that its queries may reach built and bound until the dispatch is
                // complete (VUID-RuntimeSpirv-OpRayQueryInitializeKHR and the build commands' rules).
                unsafe {
                    if let Some(queried) = &limits.queried {
                        let kind = Structure::at(structure).map(|structure| structure.kind());
                        queried.ray(query.program, &query.ray(), query.structure(), kind);
                    }
                    match &mut self.walk {
                        Some(walk) => walk.restart(structure, &query.ray()),
                        None => self.walk = Some(Walk::new(structure, &query.ray())),
                    }
                }
            }
            state::CANDIDATE | state::CONFIRMED | state::GENERATED => {
                let Some(suspended) = self.arena.find(handle, owned) else {
                    query.set(row::STATE, state::OVER);
                    return Ok(false);
                };
                std::mem::swap(&mut self.walk, &mut suspended.walk);
                verdict = decide(self.walk.as_mut(), query, stands);
            }
            _ => {
                self.arena.remove(handle, owned);
                query.set(row::HANDLE, 0);
                return Ok(false);
            }
        }
        let Some(walk) = &mut self.walk else {
            return Ok(false);
        };
        let mut fuel = FUEL;
        let event = loop {
            match walk.resume(walker, verdict, &mut fuel) {
                Event::OutOfFuel => {
                    limits.check()?;
                    fuel = FUEL;
                    verdict = Verdict::Continue;
                }
                event => break event,
            }
        };
        describe(walk, query, words, event != Event::Done);
        if event == Event::Done {
            self.arena.remove(query.word(row::HANDLE), owned);
            query.set(row::HANDLE, 0);
            query.set(row::STATE, state::OVER);
            return Ok(false);
        }
        let handle = match query.word(row::HANDLE) {
            0 => self.arena.add(query.lane, owned)?,
            handle => handle,
        };
        if let Some(suspended) = self.arena.find(handle, owned) {
            std::mem::swap(&mut self.walk, &mut suspended.walk);
        }
        query.set(row::HANDLE, handle);
        query.set(row::STATE, state::CANDIDATE);
        Ok(true)
    }

    /// Forgets the walks that an owner has left.
    pub fn release(&mut self, owned: &mut Owned) {
        self.arena.release(owned);
    }

    /// A lane of one owner becomes a lane of another. What is left of the first may only be moved or released.
    pub fn move_lane(&mut self, from: (&mut Owned, usize), to: (&mut Owned, usize)) {
        let (from, lane) = from;
        let mut rest = 0;
        while let Some(&index) = from.0.get(rest) {
            if self.arena.suspended[index].lane as usize == lane {
                from.0.swap_remove(rest);
                self.arena.give(index, to.1, to.0);
            } else {
                rest += 1;
            }
        }
    }

    /// Forgets all walks; their owners are cleared before they are used again.
    pub fn clear(&mut self) {
        self.arena.suspended.clear();
        self.arena.count = 0;
    }
}

impl Arena {
    fn release(&mut self, owned: &mut Owned) {
        for index in owned.0.drain(..) {
            self.suspended[index].place = None;
            self.suspended.remove(index);
            self.count -= 1;
        }
    }

    fn add(&mut self, lane: usize, owned: &mut Owned) -> Result<u32, Stopped> {
        if self.count == MAX_SUSPENDED {
            return Err(Stopped::OutOfMemory);
        }
        self.count += 1;
        let index = self.suspended.take();
        self.give(index, lane, owned);
        Ok(index + 1)
    }

    fn give(&mut self, index: u32, lane: usize, owned: &mut Owned) {
        let suspended = &mut self.suspended[index];
        suspended.place = Some(owned.0.len() as u32);
        suspended.lane = lane as u8;
        owned.0.push(index);
    }

    /// The walk behind a handle, if it is one of this owner's.
    fn find(&mut self, handle: u32, owned: &Owned) -> Option<&mut Suspended> {
        let index = handle.checked_sub(1)?;
        let suspended = self.suspended.get_mut(index)?;
        let listed = owned.0.get(suspended.place? as usize) == Some(&index);
        listed.then_some(suspended)
    }

    fn remove(&mut self, handle: u32, owned: &mut Owned) {
        let Some(place) = self.find(handle, owned).and_then(|s| s.place.take()) else {
            return;
        };
        owned.0.swap_remove(place as usize);
        if let Some(&moved) = owned.0.get(place as usize) {
            self.suspended[moved].place = Some(place);
        }
        self.suspended.remove(handle - 1);
        self.count -= 1;
    }
}

/// What the shader has decided about the candidate; nonsense counts as nothing.
fn decide(walk: Option<&mut Walk>, query: &Object<'_>, stands: u32) -> Verdict {
    let Some(walk) = walk else {
        return Verdict::Continue;
    };
    let candidate = *walk.candidate();
    match stands {
        state::CONFIRMED if candidate.is_built_in() => Verdict::Accept,
        state::GENERATED if !candidate.is_built_in() => {
            let t = f32::from_bits(query.word(row::GENERATED_T));
            if walk.t_min() <= t && t <= walk.t_max() {
                walk.commit_procedural(t, 0);
            }
            Verdict::Continue
        }
        _ => Verdict::Continue,
    }
}

/// Writes what the getters read.
fn describe(walk: &Walk, query: &mut Object<'_>, words: &[QueryWord], has_candidate: bool) {
    let first_committed = words.partition_point(|word| !word.committed);
    let (candidate, committed) = words.split_at(first_committed);
    if has_candidate && !candidate.is_empty() {
        let facts = Facts::new(
            walk,
            query,
            walk.candidate(),
            u32::from(!walk.candidate().is_built_in()),
        );
        for (index, word) in candidate.iter().enumerate() {
            query.set(row::WORDS + index, facts.word(*word));
        }
    }
    if let Some(hit) = walk.committed()
        && !committed.is_empty()
    {
        let facts = Facts::new(walk, query, hit, if hit.is_built_in() { 1 } else { 2 });
        for (index, word) in committed.iter().enumerate() {
            query.set(row::WORDS + first_committed + index, facts.word(*word));
        }
    }
}

/// The object of a query in one lane.
struct Object<'a> {
    rows: &'a mut [AlignedRow],
    lane: usize,
    /// Tells the programs of the process apart.
    program: u64,
}

impl Object<'_> {
    fn word(&self, row: usize) -> u32 {
        self.rows[row].0[self.lane]
    }

    fn set(&mut self, row: usize, word: u32) {
        self.rows[row].0[self.lane] = word;
    }

    fn structure(&self) -> u64 {
        self.word(row::STRUCTURE) as u64 | (self.word(row::STRUCTURE + 1) as u64) << 32
    }

    fn ray(&self) -> Ray {
        let float = |row| f32::from_bits(self.word(row));
        let vector = |row| [float(row), float(row + 1), float(row + 2)];
        Ray {
            origin: vector(row::ORIGIN),
            t_min: float(row::T_MIN),
            direction: vector(row::DIRECTION),
            t_max: float(row::T_MAX),
            flags: self.word(row::FLAGS),
            cull_mask: self.word(row::CULL_MASK),
        }
    }
}

/// All about one intersection; what has to be looked up is, once, if asked for.
struct Facts<'a> {
    ray: &'a Ray,
    hit: &'a Hit,
    /// `OpRayQueryGetIntersectionTypeKHR`.
    ty: u32,
    structure: Option<Structure>,
    object_to_world: OnceCell<[f32; 12]>,
    world_to_object: OnceCell<[f32; 12]>,
    vertices: OnceCell<[[f32; 3]; 3]>,
    ends: OnceCell<([[f32; 3]; 2], [f32; 2])>,
}

impl<'a> Facts<'a> {
    fn new(walk: &'a Walk, query: &Object<'_>, hit: &'a Hit, ty: u32) -> Self {
        Self {
            ray: walk.ray(),
            hit,
            ty,
            // SAFETY: as for the walk: the structure is built and bound until the dispatch is complete.
            structure: unsafe { Structure::at(query.structure()) },
            object_to_world: OnceCell::new(),
            world_to_object: OnceCell::new(),
            vertices: OnceCell::new(),
            ends: OnceCell::new(),
        }
    }

    fn word(&self, word: QueryWord) -> u32 {
        let (hit, component) = (self.hit, word.component as usize);
        match word.field {
            QueryField::IntersectionType => self.ty,
            QueryField::T => hit.t.to_bits(),
            QueryField::InstanceCustomIndex => hit.instance_custom_index,
            QueryField::InstanceId => hit.instance_index,
            QueryField::InstanceSbtOffset => hit.instance_sbt_offset,
            QueryField::GeometryIndex => hit.geometry_index,
            QueryField::PrimitiveIndex => hit.primitive_index,
            QueryField::Barycentrics => hit.barycentrics[component].to_bits(),
            QueryField::FrontFace => {
                u32::from(hit.hit_kind == traversal::ray::HIT_KIND_FRONT_FACING_TRIANGLE)
            }
            QueryField::AabbOpaque => u32::from(hit.opaque),
            QueryField::IsSphere => u32::from(hit.swept == Swept::Sphere),
            QueryField::IsLss => u32::from(hit.swept == Swept::LinearSweptSphere),
            QueryField::LssHitValue => hit.barycentrics[0].to_bits(),
            QueryField::SweptPositions => self.ends().0.as_flattened()[component].to_bits(),
            QueryField::HitKind => hit.hit_kind as u32 | primitive_of(hit) << 8,
            QueryField::Slot => hit.slot,
            QueryField::SweptRadii => self.ends().1[component].to_bits(),
            QueryField::ObjectRayDirection => {
                to_object(self.world_to_object(), component, &self.ray.direction, 0.0).to_bits()
            }
            QueryField::ObjectRayOrigin => {
                to_object(self.world_to_object(), component, &self.ray.origin, 1.0).to_bits()
            }
            // Column-major 4 × 3 of a row-major 3 × 4.
            QueryField::ObjectToWorld => {
                self.object_to_world()[component % 3 * 4 + component / 3].to_bits()
            }
            QueryField::WorldToObject => {
                self.world_to_object()[component % 3 * 4 + component / 3].to_bits()
            }
            QueryField::TriangleVertexPositions => {
                let vertices = self.vertices.get_or_init(|| {
                    let structure = self.structure.as_ref();
                    structure.map_or_else(Default::default, |s| s.triangle_vertices(hit))
                });
                vertices[component / 3][component % 3].to_bits()
            }
        }
    }

    /// Ends and radii of a sphere or linear swept sphere.
    fn ends(&self) -> &([[f32; 3]; 2], [f32; 2]) {
        self.ends.get_or_init(|| {
            let structure = self.structure.as_ref();
            structure.map_or_else(Default::default, |s| s.swept_ends(self.hit))
        })
    }

    fn object_to_world(&self) -> &[f32; 12] {
        self.object_to_world.get_or_init(|| {
            let structure = self.structure.as_ref();
            structure.map_or([0.0; 12], |s| s.object_to_world(self.hit.instance_index))
        })
    }

    fn world_to_object(&self) -> &[f32; 12] {
        self.world_to_object.get_or_init(|| {
            let structure = self.structure.as_ref();
            structure.map_or([0.0; 12], |s| s.world_to_object(self.hit.instance_index))
        })
    }
}
