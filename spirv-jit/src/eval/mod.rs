//! The one definition of what each operation computes, on scalars. Tiers are tested against it.
