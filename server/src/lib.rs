//! The binary avln: command line, configuration and wiring.
