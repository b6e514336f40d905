"""Contact between fragments.

From top to bottom: `broad_phase`, which pairs may meet in a step; `islands`, the fragments that these join; `face_pairs`, the
gap between two footprints; `face_overlaps`, their overlaps, each of which is a face; `face_states`, what is known of a face;
`face_forces`, one sub-step of faces that crush each other; `crushing_step`, how long sub-steps may be, and all of them; `faces`,
a step of all islands and the faces kept between steps; `land`, the constraint of land.
"""
