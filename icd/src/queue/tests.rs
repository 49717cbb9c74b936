use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use ash::vk;
use spirv_jit::Program;
use spirv_jit::ir::text::parse_module;

use super::{Queue, Submission};
use crate::command::{Command, TransferCommand};
use crate::execute::{Engine, EngineOptions};
use crate::handle::{self, Ref};
use crate::object::captured::Captured;
use crate::object::live_memory::LiveMemory;
use crate::object::pipeline::PipelineKind;
use crate::object::{Event, Fence, Pipeline, PipelineLayout, QueryPool, Semaphore};

fn engine() -> Arc<Engine> {
    let memory = LiveMemory::everywhere();
    Engine::new(2, Arc::default(), memory, EngineOptions::default())
}

fn semaphore(engine: &Engine, ty: vk::SemaphoreType) -> Ref<Semaphore> {
    handle::new(Semaphore::new(ty, 0, Arc::clone(&engine.waiting)))
}

fn wait(engine: &Engine, fence: &Fence) -> crate::VkResult {
    engine
        .waiting
        .wait_until(10_000_000_000, || fence.is_signaled())
}

type BufferWords = [AtomicU32; 5];

fn fill(words: &[AtomicU32], word: u32) -> Arc<Vec<Command>> {
    Arc::new(vec![Command::Transfer(TransferCommand::FillBuffer {
        address: words.as_ptr() as u64,
        size_bytes: size_of_val(words) as u64,
        word,
    })])
}

#[test]
fn a_wait_may_be_submitted_before_its_signal() {
    let engine = engine();
    let (first, second) = (
        Queue::new(0, Arc::clone(&engine)),
        Queue::new(1, Arc::clone(&engine)),
    );
    let timeline = semaphore(&engine, vk::SemaphoreType::TIMELINE);
    let binary = semaphore(&engine, vk::SemaphoreType::BINARY);
    let fence = handle::new(Fence::new(false));
    let (source, copy) = (BufferWords::default(), BufferWords::default());
    let waits_for_both = Submission {
        waits: vec![(Arc::clone(&timeline), 7), (Arc::clone(&binary), 0)],
        commands: vec![Arc::new(vec![Command::Transfer(
            TransferCommand::CopyBuffer {
                source: source.as_ptr() as u64,
                destination: copy.as_ptr() as u64,
                size_bytes: 20,
            },
        )])],
        fence: Some(Arc::clone(&fence)),
        ..Submission::default()
    };
    assert!(first.submit([waits_for_both]).is_ok());
    assert!(!fence.is_signaled());
    let fills = Submission {
        commands: vec![fill(&source, 3), fill(&source[..2], 9)],
        signals: vec![(Arc::clone(&binary), 0)],
        ..Submission::default()
    };
    let signals = Submission {
        signals: vec![(Arc::clone(&timeline), 8)],
        ..Submission::default()
    };
    assert!(second.submit([fills, signals]).is_ok());
    assert!(wait(&engine, &fence).is_ok());
    assert_eq!(
        copy.each_ref().map(|word| word.load(Ordering::Relaxed)),
        [9, 9, 3, 3, 3]
    );
    assert_eq!((timeline.value(), binary.value()), (8, 0));
    assert!(first.wait_idle().is_ok() && second.wait_idle().is_ok());
    first.close();
    second.close();
}

#[test]
fn events_and_queries_reach_the_host() {
    let engine = engine();
    let queue = Queue::new(0, Arc::clone(&engine));
    let events = [(); 2].map(|()| handle::new(Event::new(Arc::clone(&engine.waiting))));
    let pool = QueryPool::new(
        vk::QueryType::TIMESTAMP,
        Default::default(),
        2,
        Arc::clone(&engine.waiting),
    );
    let pool = handle::new(pool.ok().unwrap());
    let commands = vec![
        Command::WriteTimestamp {
            pool: Arc::clone(&pool),
            query: 0,
        },
        Command::SetEvent(Arc::clone(&events[0])),
        Command::WaitEvents(events.to_vec()),
        Command::ResetEvent(Arc::clone(&events[1])),
        Command::WriteTimestamp {
            pool: Arc::clone(&pool),
            query: 1,
        },
    ];
    let submission = Submission {
        commands: vec![Arc::new(commands)],
        ..Submission::default()
    };
    assert!(queue.submit([submission]).is_ok());
    assert!(pool.wait(0, 1).is_ok());
    assert_eq!(pool.value(1), None);
    events[1].set();
    assert!(queue.wait_idle().is_ok());
    assert!(events[0].is_set() && !events[1].is_set());
    assert!(pool.value(0) <= pool.value(1));
    queue.close();
}

#[test]
fn a_lost_device_ends_every_wait() {
    let engine = engine();
    let queue = Queue::new(0, Arc::clone(&engine));
    let (never, fence) = (
        semaphore(&engine, vk::SemaphoreType::BINARY),
        handle::new(Fence::new(false)),
    );
    let submission = Submission {
        waits: vec![(never, 0)],
        fence: Some(Arc::clone(&fence)),
        ..Submission::default()
    };
    assert!(queue.submit([submission]).is_ok());
    std::thread::scope(|scope| {
        scope.spawn(|| engine.shut_down());
        assert_eq!(wait(&engine, &fence), Err(vk::Result::ERROR_DEVICE_LOST));
    });
    assert_eq!(queue.wait_idle(), Err(vk::Result::ERROR_DEVICE_LOST));
    assert_eq!(queue.submit([]), Err(vk::Result::ERROR_DEVICE_LOST));
    queue.close();
}

/// A dispatch of one workgroup of a compute program with this body.
fn dispatch(body: &str) -> Arc<Vec<Command>> {
    let text = format!("module compute\nfunc f0 {{\n{body}\n}}");
    let program = Program::new(&parse_module(&text).unwrap()).unwrap();
    let pipeline = Pipeline {
        captured: Captured::default(),
        layout: handle::new(PipelineLayout::new(Vec::new(), 0)),
        kind: PipelineKind::Compute(Arc::new(program)),
    };
    Arc::new(vec![
        Command::BindPipeline(handle::new(pipeline)),
        Command::Dispatch {
            base: [0; 3],
            count: [1; 3],
        },
    ])
}

/// Asserts the effects of a failure on the device: the fence is not signaled, and every caller
/// receives the loss.
fn assert_lost(engine: &Arc<Engine>, commands: Arc<Vec<Command>>) {
    let queue = Queue::new(0, Arc::clone(engine));
    let fence = handle::new(Fence::new(false));
    let submission = Submission {
        commands: vec![commands],
        fence: Some(Arc::clone(&fence)),
        ..Submission::default()
    };
    assert!(queue.submit([submission]).is_ok());
    assert_eq!(wait(engine, &fence), Err(vk::Result::ERROR_DEVICE_LOST));
    assert_eq!(queue.wait_idle(), Err(vk::Result::ERROR_DEVICE_LOST));
    assert!(!fence.is_signaled());
    queue.close();
}

#[test]
fn a_hanging_shader_loses_the_device() {
    let timeout = Some(Duration::from_millis(20));
    let options = EngineOptions {
        timeout,
        ..EngineOptions::default()
    };
    let engine = Engine::new(2, Arc::default(), LiveMemory::everywhere(), options);
    assert_lost(&engine, dispatch("loop L0 {\nbr L0\n}\nunreachable"));
}

#[test]
fn a_panic_at_work_loses_the_device_and_not_the_process() {
    // No compute shader can call a callable: the front end would have refused it.
    let body = "v0: i32 = const 0\nv1: i32 = execute_callable v0, v0\nend";
    assert_lost(&engine(), dispatch(body));
}
