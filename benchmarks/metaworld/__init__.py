"""Manipulation tasks of Metaworld, learned from 1, 5 or 20 demonstrations and run as closed loops.

`make metaworld` runs it in an environment of its own. A task goes through these files in order:
`tasks`, `simulation`, `recording`, `learners` (with `features` and `baselines`), `evaluation`,
`results`, `report`.
"""
