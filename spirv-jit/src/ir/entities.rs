//! Index newtypes: a `Value` is not a `Label`, and both print as the IR's text form.

use std::fmt;

macro_rules! entity {
    ($(#[$doc:meta])* $name:ident, $prefix:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);

        impl $name {
            /// The entity as an index into its table.
            pub fn index(self) -> usize {
                self.0 as usize
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!($prefix, "{}"), self.0)
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Display::fmt(self, f)
            }
        }
    };
}

entity!(
    /// A scalar SSA value of one function.
    Value, "v"
);
entity!(
    /// The target of a `br`: a construct of one function.
    Label, "L"
);
entity!(
    /// A function of a module; the entry is `f0`.
    FunctionId, "f"
);
entity!(
    /// Per-lane memory of one function.
    VariableId, "var"
);
