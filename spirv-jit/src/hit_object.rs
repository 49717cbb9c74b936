//! The layout of a hit object (`OpTypeHitObjectEXT`, `OpTypeHitObjectNV`): a list of 32-bit words
//! in per-lane memory, so that the passes see into it.
#![forbid(unsafe_code)]

/// The words.
pub mod word {
    use crate::types::Type;

    /// Low byte: one of [`super::kind`]; second byte: the ray's cull mask.
    pub const KIND: usize = 0;
    /// Index into the table of hit or of miss records.
    pub const RECORD_INDEX: usize = 1;
    /// The ray's flags.
    pub const FLAGS: usize = 2;
    /// Three words.
    pub const ORIGIN: usize = 3;
    pub const T_MIN: usize = 6;
    /// Three words.
    pub const DIRECTION: usize = 7;
    /// The hit's distance; of a miss, the ray's `t_max`.
    pub const T_MAX: usize = 10;
    /// Address of the top level, two words.
    pub const STRUCTURE: usize = 11;
    pub const INSTANCE: usize = 13;
    pub const GEOMETRY: usize = 14;
    pub const PRIMITIVE: usize = 15;
    /// Low byte: the hit kind; second byte: one of [`super::primitive`].
    pub const HIT_KIND: usize = 16;
    /// Where traversal found the primitive; all ones if it did not.
    pub const SLOT: usize = 17;
    pub const TIME: usize = 18;
    /// [`ATTRIBUTE_WORDS`] words.
    pub const ATTRIBUTES: usize = 19;
    pub const ATTRIBUTE_WORDS: usize = 8;
    /// All of them.
    pub const COUNT: usize = ATTRIBUTES + ATTRIBUTE_WORDS;

    /// The type of a word.
    pub const fn ty(index: usize) -> Type {
        match index {
            ORIGIN..=T_MAX | TIME => Type::F32,
            _ => Type::I32,
        }
    }
}

/// The kind of a hit object.
pub mod kind {
    pub const EMPTY: u32 = 0;
    pub const MISS: u32 = 1;
    pub const HIT: u32 = 2;
    /// The bits of [`word::KIND`](super::word::KIND) that hold it.
    pub const MASK: u32 = 0xff;
}

/// The kind of primitive that was hit.
pub mod primitive {
    pub const BOX: u32 = 0;
    pub const TRIANGLE: u32 = 1;
    pub const SPHERE: u32 = 2;
    pub const LINEAR_SWEPT_SPHERE: u32 = 3;
}

/// The words that tracing gives, in order; the others are the ray's.
pub const TRACED: [usize; 16] = [
    word::KIND,
    word::T_MAX,
    word::RECORD_INDEX,
    word::INSTANCE,
    word::GEOMETRY,
    word::PRIMITIVE,
    word::HIT_KIND,
    word::SLOT,
    word::ATTRIBUTES,
    word::ATTRIBUTES + 1,
    word::ATTRIBUTES + 2,
    word::ATTRIBUTES + 3,
    word::ATTRIBUTES + 4,
    word::ATTRIBUTES + 5,
    word::ATTRIBUTES + 6,
    word::ATTRIBUTES + 7,
];

/// The words that name a hit to the scheduler, in order.
pub const IDENTITY: [usize; 9] = [
    word::KIND,
    word::RECORD_INDEX,
    word::STRUCTURE,
    word::STRUCTURE + 1,
    word::INSTANCE,
    word::GEOMETRY,
    word::PRIMITIVE,
    word::SLOT,
    word::TIME,
];
