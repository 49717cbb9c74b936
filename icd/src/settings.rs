//! Settings from the environment: every variable `TUFF_…` is read here, once, and nowhere else. An
//! invalid value is refused: no device is created.

#![forbid(unsafe_code)]

use std::ops::RangeInclusive;
use std::sync::OnceLock;
use std::time::Duration;

use ash::vk::ConformanceVersion;
use lanes::Tier;
use log::LevelFilter;
use spirv_jit::{Accuracy, pass};
use traversal::{Options, Specialisation, Walker};

use crate::os::CODE_PAGES;
use crate::timeline;

/// The settings of the process.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Of shaders' functions.
    pub accuracy: Accuracy,
    walks: Options,
    /// Whether shaders may have native code (`TUFF_NATIVE`).
    pub native: bool,
    /// Subgroups of a wave, at most (`TUFF_WAVE`).
    pub wave: usize,
    /// Whether lines of ray generation shaders are taken on directly (`TUFF_DIRECT`).
    pub direct: bool,
    /// Whether all geometry is opaque to pipelines without any-hit shaders.
    pub opaque_without_any_hit: bool,
    /// The number of worker threads of a device (`TUFF_THREADS`); by default, the processors that
    /// the process may use.
    pub threads: Option<usize>,
    /// Which messages are printed (`TUFF_LOG`).
    pub log: LevelFilter,
    /// How long one dispatch may run before the device is lost (`TUFF_TIMEOUT`); unset: a picture
    /// may take hours.
    pub timeout: Option<Duration>,
    /// Whether devices check what only execution can see, even if the application does not ask
    /// (`TUFF_VALIDATE`).
    pub validate: bool,
    /// Whether the table of how full waves were is printed (`TUFF_STATS`).
    pub stats: bool,
    /// Bytes of messages of shaders that one launch may print, where they are printed
    /// (`TUFF_DEBUG_PRINTF`, `TUFF_DEBUG_PRINTF_BYTES`).
    pub prints: Option<usize>,
    /// The file of the timeline (`TUFF_TRACE`).
    pub trace: Option<&'static str>,
    /// Captures (`TUFF_CAPTURE`, `TUFF_CAPTURE_PIXEL`).
    pub capture: Option<CaptureSettings>,
    /// The value of `VkPhysicalDeviceDriverProperties::conformanceVersion` (`TUFF_CONFORMANCE`).
    /// Zeros, the default, claim nothing.
    pub conformance: ConformanceVersion,
}

/// Whose rays are captured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CaptureSettings {
    /// The launch index, or global invocation index, whose rays are told one by one
    /// (`TUFF_CAPTURE_PIXEL`); unset: all invocations are counted.
    pub invocation: Option<[u32; 3]>,
    /// Where the files are written (`TUFF_CAPTURE`); unset: text goes to standard error.
    pub folder: Option<&'static str>,
    /// The first frame and the last (`TUFF_CAPTURE_FRAMES`); unset: all.
    frames: Option<[u64; 2]>,
}

impl CaptureSettings {
    /// The frames of which commands are captured, counted in presents.
    pub fn frames(&self) -> RangeInclusive<u64> {
        let [first, last] = self.frames.unwrap_or([0, u64::MAX]);
        first..=last
    }

    /// # Errors
    /// As [`Settings::parse`].
    fn read(read: &Read<'_>) -> Result<Option<Self>, String> {
        let invocation = read.parsed("TUFF_CAPTURE_PIXEL", PIXEL, invocation)?;
        let frames = read.parsed("TUFF_CAPTURE_FRAMES", FRAMES, frames)?;
        let folder = (read.value)("TUFF_CAPTURE");
        if invocation.is_none() && folder.is_none() {
            return match frames {
                Some(_) => Err(WITHOUT_CAPTURE.into()),
                None => Ok(None),
            };
        }
        Ok(Some(Self {
            invocation,
            // Settings are read once.
            folder: folder.map(|path| &*path.leak()),
            frames,
        }))
    }
}

const WITHOUT_CAPTURE: &str =
    "TUFF_CAPTURE_FRAMES: without TUFF_CAPTURE or TUFF_CAPTURE_PIXEL nothing is captured";

/// The switch for [`Settings::opaque_without_any_hit`].
const NO_ANY_HIT: &str = "no_any_hit";

/// The variables' values, by name.
type Lookup<'a> = dyn Fn(&str) -> Option<String> + 'a;

impl Settings {
    /// From the variables' values; an empty one is as good as none.
    ///
    /// # Errors
    /// The error of one setting, in one line that names it.
    fn parse(lookup: &Lookup) -> Result<Settings, String> {
        let value = |name: &str| lookup(name).filter(|text| !text.is_empty());
        let accuracy: Accuracy = match value("TUFF_ACCURACY") {
            None => Accuracy::Spec,
            Some(text) => text
                .parse()
                .map_err(|error| format!("TUFF_ACCURACY: {error}"))?,
        };
        let tier = match value("TUFF_TIER") {
            None => Tier::best(),
            Some(text) => {
                let tier: Tier = text
                    .parse()
                    .map_err(|error| format!("TUFF_TIER: {error}"))?;
                tier.min(Tier::best())
            }
        };
        let mut without = Vec::new();
        let mut opaque_without_any_hit = true;
        let disabled = value("TUFF_DISABLE").unwrap_or_default();
        let names = disabled.split(',').map(str::trim);
        for name in names.filter(|name| !name.is_empty()) {
            match Specialisation::ALL.iter().find(|(known, _)| *known == name) {
                Some(&(_, specialisation)) => without.push(specialisation),
                None if name == NO_ANY_HIT => opaque_without_any_hit = false,
                None if pass::is_switch(name) => {}
                None => return Err(format!("TUFF_DISABLE: {}", unknown(name))),
            }
        }
        let read = Read { value: &value };
        let prints = read.parsed("TUFF_DEBUG_PRINTF", "0 or 1", switch)? != Some(false);
        let print_bytes = read.parsed("TUFF_DEBUG_PRINTF_BYTES", "a number of bytes", bytes)?;
        Ok(Settings {
            accuracy,
            native: read.parsed("TUFF_NATIVE", "0 or 1", switch)? != Some(false),
            wave: (read.parsed("TUFF_WAVE", "a number of subgroups", subgroups)?)
                .unwrap_or(usize::MAX),
            direct: read.parsed("TUFF_DIRECT", "0 or 1", switch)? != Some(false),
            opaque_without_any_hit,
            threads: read.parsed("TUFF_THREADS", "a number of threads, 1 to 1024", threads)?,
            log: (read.parsed("TUFF_LOG", LEVELS, level)?).unwrap_or(LevelFilter::Error),
            timeout: (read.parsed(
                "TUFF_TIMEOUT",
                "a number of seconds, 0 for no limit",
                seconds,
            )?)
            .filter(|timeout| !timeout.is_zero()),
            validate: read.parsed("TUFF_VALIDATE", "0 or 1", switch)? == Some(true),
            stats: read.parsed("TUFF_STATS", "0 or 1", switch)? == Some(true),
            prints: prints.then(|| print_bytes.unwrap_or(PRINT_BYTES)),
            // Settings are read once.
            trace: value("TUFF_TRACE").map(|path| &*path.leak()),
            capture: CaptureSettings::read(&read)?,
            conformance: (read.parsed("TUFF_CONFORMANCE", CONFORMANCE, conformance)?)
                .unwrap_or_default(),
            walks: Options {
                // Less accuracy than the default gains nothing in walks: docs/accuracy.md.
                accuracy: match accuracy {
                    Accuracy::Fast | Accuracy::Spec => traversal::Accuracy::Spec,
                    Accuracy::Exact => traversal::Accuracy::Exact,
                },
                without: without.into_iter().collect(),
                tier,
                ..Options::default()
            },
        })
    }

    /// A walker for one thread.
    pub fn walker(&self) -> Box<Walker> {
        Walker::with(self.walks).expect("the best tier is available")
    }
}

/// Variables whose values are refused alike.
struct Read<'a> {
    value: &'a Lookup<'a>,
}

impl Read<'_> {
    /// A variable's value; none where it is not set.
    ///
    /// # Errors
    /// The value is not what `expected` says.
    fn parsed<T>(
        &self,
        name: &str,
        expected: &str,
        parse: impl FnOnce(&str) -> Option<T>,
    ) -> Result<Option<T>, String> {
        let Some(text) = (self.value)(name) else {
            return Ok(None);
        };
        match parse(&text) {
            Some(value) => Ok(Some(value)),
            None => Err(format!("{name}: \"{text}\" is not {expected}")),
        }
    }
}

const LEVELS: &str = "one of off, error, warn, info, debug";
/// Bytes of messages of shaders that one launch may print by default.
const PRINT_BYTES: usize = 1 << 20;

const CONFORMANCE: &str = "a version of four numbers up to 255, such as 1.3.8.0";

fn subgroups(text: &str) -> Option<usize> {
    text.parse().ok().filter(|&subgroups| subgroups > 0)
}

fn threads(text: &str) -> Option<usize> {
    text.parse().ok().filter(|count| (1..=1024).contains(count))
}

fn bytes(text: &str) -> Option<usize> {
    text.parse().ok()
}

const PIXEL: &str = "two or three whole numbers, such as 320,200";
const FRAMES: &str = "a number of a frame or two, such as 10..12";

fn invocation(text: &str) -> Option<[u32; 3]> {
    let numbers: Vec<u32> = (text.split(','))
        .map(|number| number.trim().parse().ok())
        .collect::<Option<_>>()?;
    match numbers[..] {
        [x, y] => Some([x, y, 0]),
        [x, y, z] => Some([x, y, z]),
        _ => None,
    }
}

fn frames(text: &str) -> Option<[u64; 2]> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let frames = [first.trim().parse().ok()?, last.trim().parse().ok()?];
    (frames[0] <= frames[1]).then_some(frames)
}

fn level(text: &str) -> Option<LevelFilter> {
    match text {
        "off" | "error" | "warn" | "info" | "debug" => text.parse().ok(),
        _ => None,
    }
}

fn seconds(text: &str) -> Option<Duration> {
    Duration::try_from_secs_f64(text.parse().ok()?).ok()
}

fn switch(text: &str) -> Option<bool> {
    match text {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    }
}

fn conformance(text: &str) -> Option<ConformanceVersion> {
    let numbers: Vec<u8> = (text.split('.'))
        .map(|number| number.parse().ok())
        .collect::<Option<_>>()?;
    let [major, minor, subminor, patch] = numbers[..] else {
        return None;
    };
    Some(ConformanceVersion {
        major,
        minor,
        subminor,
        patch,
    })
}

fn unknown(name: &str) -> String {
    let walks = Specialisation::ALL.iter().map(|(name, _)| *name);
    let passes = pass::PASSES.iter().map(|pass| pass.name);
    let known: Vec<&str> = walks
        .chain([NO_ANY_HIT])
        .chain(passes)
        .chain(["passes"])
        .collect();
    format!("\"{name}\" is not one of {}", known.join(", "))
}

/// The process's settings.
///
/// # Errors
/// A variable has a value that it cannot have.
pub fn checked() -> Result<&'static Settings, &'static str> {
    static SETTINGS: OnceLock<Result<Settings, String>> = OnceLock::new();
    let settings = SETTINGS.get_or_init(|| {
        let environment = |name: &str| {
            let value = std::env::var_os(name)?;
            Some(value.to_string_lossy().into_owned())
        };
        let settings = Settings::parse(&environment)?;
        log::set_max_level(settings.log);
        let list = |name| environment(name).unwrap_or_default();
        pass::configure(&list("TUFF_DISABLE"), &list("TUFF_PRINT"));
        if let Some(path) = settings.trace {
            timeline::start(path);
        }
        // One limit for all: programs and samplers, walks and builds.
        settings.walks.tier.limit();
        spirv_jit::native::provide(settings.native.then_some(CODE_PAGES));
        Ok(settings)
    });
    settings.as_ref().map_err(String::as_str)
}

/// The process's settings. Devices are created only with [`checked`] ones.
pub fn settings() -> &'static Settings {
    checked().expect("devices are created with valid settings")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(values: &[(&str, &str)]) -> Result<Settings, String> {
        let value = |wanted: &str| {
            let found = values.iter().find(|(name, _)| *name == wanted);
            found.map(|(_, value)| (*value).to_owned())
        };
        Settings::parse(&value)
    }

    #[test]
    fn values_are_taken() {
        let plain = parse(&[]).unwrap();
        assert_eq!(plain.accuracy, Accuracy::Spec);
        assert_eq!((plain.wave, plain.threads), (usize::MAX, None));
        assert_eq!((plain.log, plain.timeout), (LevelFilter::Error, None));
        assert_eq!((plain.validate, plain.stats), (false, false));
        assert!(plain.native);
        assert!(plain.opaque_without_any_hit);
        assert_eq!(plain.prints, Some(1 << 20));
        let zeros = [plain.conformance.major, plain.conformance.subminor];
        assert_eq!(zeros, [0, 0]);
        let set = parse(&[
            ("TUFF_ACCURACY", "exact"),
            ("TUFF_TIER", "portable"),
            ("TUFF_NATIVE", "0"),
            ("TUFF_DISABLE", "packets, simplify"),
            ("TUFF_WAVE", "4"),
            ("TUFF_DIRECT", "0"),
            ("TUFF_THREADS", "3"),
            ("TUFF_LOG", "info"),
            ("TUFF_TIMEOUT", "0.5"),
            ("TUFF_VALIDATE", "1"),
            ("TUFF_STATS", "1"),
            ("TUFF_DEBUG_PRINTF_BYTES", "4096"),
            ("TUFF_TRACE", "frame.json"),
            ("TUFF_CONFORMANCE", "1.3.8.0"),
        ])
        .unwrap();
        assert_eq!(set.accuracy, Accuracy::Exact);
        assert_eq!(set.walks.accuracy, traversal::Accuracy::Exact);
        assert_eq!(set.walks.tier, Tier::Portable);
        assert!(set.walks.without.contains(Specialisation::Packets));
        assert!(!set.walks.without.contains(Specialisation::Opaque));
        assert!(set.opaque_without_any_hit);
        assert_eq!((set.wave, set.threads), (4, Some(3)));
        assert!(plain.direct && !set.direct);
        assert_eq!(set.log, LevelFilter::Info);
        assert_eq!(set.timeout, Some(Duration::from_millis(500)));
        assert_eq!((set.validate, set.stats), (true, true));
        assert!(!set.native);
        assert_eq!((plain.trace, set.trace), (None, Some("frame.json")));
        assert_eq!(set.prints, Some(4096));
        let version = set.conformance;
        let numbers = [
            version.major,
            version.minor,
            version.subminor,
            version.patch,
        ];
        assert_eq!(numbers, [1, 3, 8, 0]);
        let without = parse(&[("TUFF_DISABLE", "no_any_hit")]).unwrap();
        assert!(!without.opaque_without_any_hit);
        let off = [
            ("TUFF_TIMEOUT", "0"),
            ("TUFF_VALIDATE", "0"),
            ("TUFF_DEBUG_PRINTF", "0"),
            ("TUFF_THREADS", ""),
        ];
        let off = parse(&off).unwrap();
        assert_eq!(
            (off.timeout, off.validate, off.threads),
            (None, false, None)
        );
        assert_eq!(off.prints, None);
    }

    #[test]
    fn captures_are_of_an_invocation_and_of_frames() {
        let pixel = |values: &[(&str, &str)]| parse(values).map(|it| it.capture);
        assert_eq!(pixel(&[]), Ok(None));
        let plain = pixel(&[("TUFF_CAPTURE_PIXEL", "3, 4")]).unwrap().unwrap();
        assert_eq!((plain.invocation, plain.folder), (Some([3, 4, 0]), None));
        assert_eq!(plain.frames(), 0..=u64::MAX);
        let set = pixel(&[
            ("TUFF_CAPTURE_PIXEL", "3,4,5"),
            ("TUFF_CAPTURE", "here"),
            ("TUFF_CAPTURE_FRAMES", "10..12"),
        ]);
        let set = set.unwrap().unwrap();
        let place = (Some([3, 4, 5]), Some("here"));
        assert_eq!((set.invocation, set.folder), place);
        assert_eq!(set.frames(), 10..=12);
        let maps = pixel(&[("TUFF_CAPTURE", "here")]).unwrap().unwrap();
        assert_eq!((maps.invocation, maps.folder), (None, Some("here")));
        let message = pixel(&[("TUFF_CAPTURE_FRAMES", "7")]).unwrap_err();
        assert_eq!(message, WITHOUT_CAPTURE);
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let cases = [
            (
                "TUFF_ACCURACY",
                "best",
                "is not one of fast, spec and exact",
            ),
            ("TUFF_TIER", "sse9", "is not one of portable, avx2, avx512"),
            ("TUFF_NATIVE", "off", "is not 0 or 1"),
            ("TUFF_DISABLE", "pakets", "is not one of packets,"),
            ("TUFF_WAVE", "0", "is not a number of subgroups"),
            ("TUFF_DIRECT", "on", "is not 0 or 1"),
            ("TUFF_THREADS", "0", "is not a number of threads, 1 to 1024"),
            (
                "TUFF_THREADS",
                "1025",
                "is not a number of threads, 1 to 1024",
            ),
            ("TUFF_THREADS", "all", "is not a number of threads"),
            (
                "TUFF_LOG",
                "loud",
                "is not one of off, error, warn, info, debug",
            ),
            ("TUFF_TIMEOUT", "-1", "is not a number of seconds"),
            ("TUFF_TIMEOUT", "nan", "is not a number of seconds"),
            ("TUFF_TIMEOUT", "1e30", "is not a number of seconds"),
            ("TUFF_TIMEOUT", "soon", "is not a number of seconds"),
            ("TUFF_VALIDATE", "yes", "is not 0 or 1"),
            ("TUFF_STATS", "2", "is not 0 or 1"),
            ("TUFF_CAPTURE_PIXEL", "3", "is not two or three whole"),
            ("TUFF_CAPTURE_PIXEL", "3,-4", "is not two or three whole"),
            ("TUFF_CAPTURE_PIXEL", "1,2,3,4", "is not two or three whole"),
            (
                "TUFF_CAPTURE_FRAMES",
                "12..10",
                "is not a number of a frame",
            ),
            ("TUFF_CAPTURE_FRAMES", "1..", "is not a number of a frame"),
            ("TUFF_DEBUG_PRINTF", "on", "is not 0 or 1"),
            ("TUFF_DEBUG_PRINTF_BYTES", "1k", "is not a number of bytes"),
            (
                "TUFF_CONFORMANCE",
                "1.3.8",
                "is not a version of four numbers",
            ),
            (
                "TUFF_CONFORMANCE",
                "1.3.256.0",
                "is not a version of four numbers",
            ),
        ];
        for (name, value, expected) in cases {
            let message = parse(&[(name, value)]).unwrap_err();
            let quoted = format!("{name}: \"{value}\" {expected}");
            assert!(message.starts_with(&quoted), "{message}");
        }
    }
}
