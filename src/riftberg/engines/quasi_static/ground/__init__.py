"""A bed of sediment that carries the keels of bergs: footprints, floor, heave and tilt, and the sub-steps of a landing."""
