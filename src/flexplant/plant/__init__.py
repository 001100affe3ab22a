"""Plants: a coupled system as modal, descriptor or state-space form with named inputs and outputs."""
