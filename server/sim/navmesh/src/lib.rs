//! Where one can walk and how far it is.
