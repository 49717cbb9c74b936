//! Tests of the tiles, on chunks and attachments made by hand.

mod advanced;
mod clears;
mod colors;
mod coverage;
mod direct;
mod halves;
mod joined;
mod order;
mod rectangle;
mod stencils;
mod support;
mod texels;
mod tinted;
