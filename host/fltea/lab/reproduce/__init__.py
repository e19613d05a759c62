"""Reproduce tables 1–5 and figures 2–10, 12–20 of Macias & Sierociuk 2023, over many seeds.

Modules:
    paper: the printed numbers.
    simulate: fractional systems, many seeds at once.
    scenarios, gyroscope: data with the truth, and the settings of the filters.
    runs: the engine run for every seed and length L: squared errors, and runs that diverged.
    timing: table 1.
    paper_tables: our rows next to the paper's numbers, with percentiles.
    exchange: whether tables 3 and 4 are swapped in print.
    readings: other interpretations of the printed algorithm.
    open_choices: the effect of each choice that the paper leaves open.
    figures: the paper's figures as PNG.
    request: what the user asks for.
    report: all results in the order of the paper.
    score: the effect of the guards.
"""
