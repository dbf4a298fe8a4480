//! Sound: propagation, ears and convolution.
