"""Reproduce tables 1–5 and figures 2–10, 12–20 of Macias & Sierociuk 2023, over many seeds.

Modules:
    paper: the numbers that the paper gives. simulate: simulation of fractional systems, many seeds at once.
    scenarios, gyroscope: the paper's experiments, with data, true states and settings of the filters. runs:
    runs of the engine for every seed and length L, with squared errors and runs that diverged. timing: the
    running times of table 1. paper_tables: tables of our numbers next to the paper's, with percentiles.
    exchange: whether tables 3 and 4 were exchanged when the paper was printed. readings: other
    interpretations of the paper's algorithm. open_choices: the effect of each choice that the paper leaves
    open. figures: the paper's figures as PNG. request: what the user asks for. report: all results in the
    order of the paper. score: the effect of the guards.
"""
