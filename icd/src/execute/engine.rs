//! The resources with which a device executes, shared by its queues and by host commands.

#![forbid(unsafe_code)]

use std::borrow::Cow;
use std::ffi::CStr;
use std::io::Write;
use std::ops::Range;
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use ash::vk;
use spirv_jit::abort::Aborts;
use spirv_jit::environment::Environment;
use spirv_jit::views::Views;

use crate::VkResult;
use crate::compute::Dispatcher;
use crate::object::descriptor_heap::HeapSamplers;
use crate::object::descriptor_heap_replay::Identities;
use crate::object::live_memory::LiveMemory;
use crate::object::messenger::Messengers;
use crate::object::sync::Waiting;
use crate::raster::Rasterizer;
use crate::settings::settings;
use crate::trace::Tracer;
use crate::validate::{Caller, Checks, Queried, Validator};
use crate::wave::observer::Observer;
use crate::wave::{Cause, Fault, Limits, Returned, WildAddresses, Workers};

/// The device's workers and their memory, its waits, and the state of its loss.
pub struct Engine {
    pub workers: Arc<Workers>,
    pub waiting: Arc<Waiting>,
    pub dispatcher: Dispatcher,
    pub tracer: Tracer,
    pub rasterizer: Rasterizer,
    /// The memory that addresses may point into.
    pub memory: Arc<LiveMemory>,
    /// Image views and samplers.
    pub views: Arc<Views>,
    /// Samplers that heaps embed, which have no objects.
    pub heap_samplers: HeapSamplers,
    pub image_identities: Arc<Identities>,
    /// The features that execution depends on.
    pub options: EngineOptions,
    messengers: Arc<Messengers>,
    /// The limits that all commands share.
    limits: Limits,
    /// Invalid addresses that shaders used, if the device records them.
    pub wild: Option<WildAddresses>,
    /// The reason why the device was lost.
    fault: OnceLock<Fault>,
    /// The number of fault reports that the application has fetched.
    returned: Returned,
}

/// The message id of shader messages: that of the validation layers, for which programs look.
const PRINTF: &CStr = c"WARNING-DEBUG-PRINTF";

/// The features of a device that execution depends on.
pub struct EngineOptions {
    /// Validation, if it is enabled.
    pub validator: Option<Arc<Validator>>,
    /// The time limit of a command.
    pub timeout: Option<Duration>,
    /// The feature `deviceFault` is enabled: invalid addresses of shaders are recorded.
    pub wild_addresses: bool,
    /// Receives the messages of shaders that abort, if the feature `shaderAbort` is enabled.
    pub aborts: Option<Arc<Aborts>>,
    /// The feature `depthClampZeroOne` is enabled, without `VK_EXT_depth_range_unrestricted`:
    /// depths in floating-point attachments are clamped to 0 to 1.
    pub clamps_to_one: bool,
    /// `VK_KHR_opacity_micromap` is enabled: serialized bottom levels list blocks of addresses.
    pub serializes_blocks: bool,
    /// The feature `descriptorHeapCaptureReplay` is enabled.
    pub replays_heaps: bool,
}

impl Default for EngineOptions {
    /// `TUFF_TIMEOUT` alone.
    fn default() -> Self {
        Self {
            validator: None,
            timeout: settings().timeout,
            wild_addresses: false,
            aborts: None,
            clamps_to_one: false,
            serializes_blocks: false,
            replays_heaps: false,
        }
    }
}

impl Engine {
    /// An engine with `thread_count` workers, which start with their first work.
    pub fn new(
        thread_count: usize,
        messengers: Arc<Messengers>,
        memory: Arc<LiveMemory>,
        options: EngineOptions,
    ) -> Arc<Self> {
        let views = Arc::default();
        Arc::new(Self {
            heap_samplers: HeapSamplers::new(&views, options.replays_heaps),
            image_identities: Arc::default(),
            views,
            workers: Workers::new(thread_count),
            waiting: Arc::default(),
            dispatcher: Dispatcher::default(),
            tracer: Tracer::default(),
            rasterizer: Rasterizer::default(),
            memory,
            messengers,
            limits: Limits {
                aborts: options.aborts.clone(),
                ..Limits::default()
            },
            wild: options.wild_addresses.then(WildAddresses::default),
            options,
            fault: OnceLock::new(),
            returned: Returned::default(),
        })
    }

    /// The limits of the next dispatch.
    pub fn limits(&self) -> Limits {
        Limits {
            deadline: self
                .options
                .timeout
                .and_then(|timeout| Instant::now().checked_add(timeout)),
            live: self.memory.structures(),
            query_observer: self
                .checks(Caller::Other)
                .map(|checks| Arc::new(Queried::new(checks)) as Arc<dyn Observer>),
            ..self.limits.clone()
        }
    }

    /// The time for which a command may wait for the host or another queue.
    pub fn patience_ns(&self) -> u64 {
        let timeout = self.options.timeout.map(|timeout| timeout.as_nanos());
        timeout.map_or(u64::MAX, |ns| u64::try_from(ns).unwrap_or(u64::MAX))
    }

    /// The environment of the next command's shaders, before anything is bound. With validation,
    /// their physical pointers reach only buffers with the usage for it.
    pub fn environment(&self) -> Environment {
        let reach = self.memory.reach();
        let validator = self.options.validator.as_ref();
        let reach = match validator {
            None => reach,
            Some(validator) => validator.registry.reach(reach.unbound()),
        };
        let counts_strays = validator.is_some() || self.wild.is_some();
        Environment {
            strays: counts_strays.then(Arc::default),
            aborts: self.options.aborts.clone(),
            ..Environment::new(reach, Arc::clone(&self.views))
        }
    }

    /// Sends messages of shaders to the debug messengers that accept information, or else to
    /// standard error.
    pub fn print(&self, messages: &[String]) {
        let severity = vk::DebugUtilsMessageSeverityFlagsEXT::INFO;
        let types = vk::DebugUtilsMessageTypeFlagsEXT::GENERAL
            | vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION;
        if messages.is_empty() {
            return;
        }
        if self.messengers.hear(severity, types) {
            for message in messages {
                self.messengers.send(severity, types, PRINTF, message);
            }
            return;
        }
        let mut text = messages.join("\n");
        text.push('\n');
        // A closed standard error must not end the process.
        let _ = std::io::stderr().write_all(text.as_bytes());
    }

    /// The observer of invalid addresses, if the device records them.
    pub fn wild_observer(&self) -> Option<&dyn Observer> {
        self.wild.as_ref().map(|wild| wild as &dyn Observer)
    }

    /// Validation of one command, if it is enabled.
    pub fn checks(&self, caller: Caller) -> Option<Checks> {
        let validator = self.options.validator.as_ref();
        validator.map(|validator| validator.command(caller))
    }

    /// Loses the device: all waits return `VK_ERROR_DEVICE_LOST`, and running work ends at its next
    /// check of its limits. The first reason is reported, and kept for `vkGetDeviceFaultReportsKHR`
    /// and `vkGetDeviceFaultInfoEXT`.
    pub fn lose(&self, mut fault: Fault) {
        if let Some(aborts) = &self.options.aborts {
            aborts.close();
        }
        if let Some(wild) = &self.wild {
            wild.tell(&mut fault);
        }
        if self.waiting.lost.check().is_ok() && self.fault.set(fault).is_ok() {
            let why = self.fault.get().map(Fault::to_string).unwrap_or_default();
            self.messengers
                .error(c"TUFF-device-lost", &format!("device lost: {why}"));
        }
        self.shut_down();
    }

    /// The reason why the device was lost.
    pub fn fault(&self) -> Option<Cow<'_, Fault>> {
        match self.waiting.lost.is_inherited() {
            true => Some(Cow::Owned(Fault::new(Cause::Forked))),
            false => self.fault.get().map(Cow::Borrowed),
        }
    }

    /// Calls a function with the messages of shaders that aborted, as
    /// `VkDeviceFaultShaderAbortMessageInfoKHR` has them.
    pub fn with_abort_messages<R>(&self, take: impl FnOnce(&[u8]) -> R) -> R {
        match &self.options.aborts {
            Some(aborts) if !self.waiting.lost.is_inherited() => aborts.with_messages(take),
            _ => take(&[]),
        }
    }

    /// Waits until the device is lost. Returns the number of reports that the application has not
    /// fetched.
    ///
    /// # Errors
    /// `VK_TIMEOUT`.
    pub fn wait_for_reports(&self, timeout_ns: u64) -> VkResult<u32> {
        // A device that is being destroyed has no reports.
        let waited = (self.waiting).wait_until(timeout_ns, || self.fault().is_some());
        waited.map_err(|_| vk::Result::TIMEOUT)?;
        let all = self.fault().map_or(0, |fault| fault.report_count());
        Ok(all.saturating_sub(self.returned.count(std::process::id())))
    }

    /// Takes at most `room` reports, and returns their indices in [`Self::fault`].
    pub fn take_reports(&self, room: u32) -> Range<u32> {
        let available = self.fault().map_or(0, |fault| fault.report_count());
        (self.returned).take(std::process::id(), available, room)
    }

    /// Cancels all queued and running work without reporting an error. Valid applications wait for
    /// their work before they destroy the device, so work is left only by invalid ones.
    pub fn shut_down(&self) {
        self.waiting.lost.set();
        self.limits.cancelled.store(true, Ordering::Relaxed);
        self.waiting.notify();
    }
}
