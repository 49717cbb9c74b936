//! Every elementwise kernel of every tier against `eval`, on random bits and on the bits where things go wrong.
