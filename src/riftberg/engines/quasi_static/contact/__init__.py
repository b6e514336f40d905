"""Contact between fragments.

From top to bottom: `broad_phase`, which pairs may meet in a step; `islands`, the fragments that these join; `face_pairs`, gap
and overlap of two footprints; `face_forces`, one sub-step of faces that crush each other; `crushing_step`, how long sub-steps
may be, and all of them; `faces`, a step of all islands and the pairs kept between steps; `land`, the constraint of land.
"""
