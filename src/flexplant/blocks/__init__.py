"""What a control engineer wires to the plant: each block is a `StateSpace` with named ports, and sources are tones."""
