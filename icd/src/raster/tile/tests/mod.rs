//! Tests of the tiles, on chunks and attachments made by hand.

mod advanced;
mod clears;
mod colors;
mod coverage;
mod direct;
mod joined;
mod modulate;
mod order;
mod rectangle;
mod small_rectangle;
mod stencils;
mod support;
mod texels;
