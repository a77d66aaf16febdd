"""Tasks of Metaworld seen by a camera: four numbers of state and pictures, no place of any object.

`python -m benchmarks.metaworld --camera` runs it. A task goes through these files in order:
`world`, `recording`, `learners` (with `baselines` and `act`), `evaluation` (with `disturbances`),
`results`, `report`; `command` holds it together.
"""
