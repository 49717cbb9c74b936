//! The steps of a case, which follow from numbers.

use anyhow::{Context, Result, bail};
use fastrand::Rng;

use crate::world::World;

/// Steps of a case, at most.
const MOST: u32 = 16;

/// A kind of nonsense.
pub struct FuzzTarget {
    pub name: &'static str,
    pub run: fn(&World, &Case),
}

/// A case by name.
#[derive(Clone)]
pub struct Which {
    pub target: &'static FuzzTarget,
    pub seed: u64,
    pub number: u64,
    /// The only steps that are done; `None`: all.
    pub kept: Option<Vec<u32>>,
}

impl Which {
    /// Of `TARGET:SEED:NUMBER` or `TARGET:SEED:NUMBER:STEP,STEP…`. `named` finds the target.
    pub fn parse(
        text: &str,
        named: impl FnOnce(&str) -> Result<&'static FuzzTarget>,
    ) -> Result<Which> {
        let parts: Vec<&str> = text.split(':').collect();
        let (&[target, seed, number], rest) = parts.split_first_chunk().context("a case's name")?;
        let kept = match rest {
            [] => None,
            [""] => Some(Vec::new()),
            [steps] => Some(steps.split(',').map(str::parse).collect::<Result<_, _>>()?),
            _ => bail!("{text} names no case"),
        };
        Ok(Which {
            target: named(target)?,
            seed: seed.parse()?,
            number: number.parse()?,
            kept,
        })
    }

    /// The seed of all that the case does.
    fn root(&self) -> u64 {
        let mut rng = Rng::with_seed(self.seed ^ self.number.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        rng.u64(..)
    }

    /// How many steps it has when all are done.
    pub fn step_count(&self) -> u32 {
        Rng::with_seed(self.root()).u32(1..=MOST)
    }
}

impl std::fmt::Display for Which {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}:{}", self.target.name, self.seed, self.number)?;
        if let Some(kept) = &self.kept {
            let steps: Vec<String> = kept.iter().map(u32::to_string).collect();
            write!(f, ":{}", steps.join(","))?;
        }
        Ok(())
    }
}

/// The numbers of a running case.
pub struct Case {
    root: u64,
    steps: Vec<u32>,
}

impl Case {
    pub fn new(which: &Which) -> Case {
        let all = 0..which.step_count();
        Case {
            root: which.root(),
            steps: match &which.kept {
                None => all.collect(),
                Some(kept) => kept.iter().copied().filter(|s| all.contains(s)).collect(),
            },
        }
    }

    /// Numbers for what the whole case has in common, which no left-out step changes.
    pub fn common(&self) -> Rng {
        Rng::with_seed(self.root ^ u64::MAX)
    }

    /// Numbers for each of the steps.
    pub fn steps(&self) -> impl Iterator<Item = Rng> + use<> {
        let root = self.root;
        let steps = self.steps.clone().into_iter();
        steps.map(move |step| Rng::with_seed(root.wrapping_add(u64::from(step) + 1)))
    }
}

/// A number such as breaks things.
pub fn wild(rng: &mut Rng) -> u64 {
    match rng.u32(0..9) {
        0 => 0,
        1 => 1,
        2 => u64::MAX - rng.u64(0..64),
        3 => 1 << rng.u32(0..64),
        4 => (1u64 << rng.u32(0..64)).wrapping_sub(1),
        5 => rng.u64(..),
        6 => rng.u64(0..256),
        7 => rng.u64(0..1 << 47) & !0xFF,
        _ => 0x7FFF_FFFF + rng.u64(0..3),
    }
}
