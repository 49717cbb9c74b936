//! Conditions of the registry: `(VK_VERSION_1_1,VK_KHR_a)+VK_KHR_b`, evaluated from left to right.

/// Whether a condition holds, where `holds` knows about single names. Empty ones do.
pub fn evaluate(condition: &str, holds: &impl Fn(&str) -> bool) -> bool {
    condition.is_empty() || expression(&mut condition.trim(), holds)
}

fn expression(rest: &mut &str, holds: &impl Fn(&str) -> bool) -> bool {
    let mut value = term(rest, holds);
    loop {
        let (operator, tail) = match rest.chars().next() {
            Some(operator @ ('+' | ',')) => (operator, &rest[1..]),
            _ => return value,
        };
        *rest = tail;
        let right = term(rest, holds);
        value = if operator == '+' {
            value && right
        } else {
            value || right
        };
    }
}

fn term(rest: &mut &str, holds: &impl Fn(&str) -> bool) -> bool {
    if let Some(inner) = rest.strip_prefix('(') {
        *rest = inner;
        let value = expression(rest, holds);
        *rest = rest.strip_prefix(')').unwrap_or(rest);
        return value;
    }
    let end = rest.find(['+', ',', '(', ')']).unwrap_or(rest.len());
    let (name, tail) = rest.split_at(end);
    *rest = tail;
    holds(name.trim())
}

#[test]
fn conditions_are_read_from_left_to_right() {
    let holds = |name: &str| name == "yes";
    for (condition, expected) in [
        ("", true),
        ("yes", true),
        ("no", false),
        ("no,yes", true),
        ("yes+no", false),
        ("(no,yes)+yes", true),
        ("((no+yes),yes)+(yes)", true),
        ("yes,yes+no", false),
    ] {
        assert_eq!(evaluate(condition, &holds), expected, "{condition}");
    }
}
