//! Performs recorded commands, in order, on a queue's thread.
