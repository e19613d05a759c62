"""The paper, run again: tables 1–5 and figures 2–10, 12–20 of Macias & Sierociuk 2023, over many seeds.

paper: the printed numbers. simulate: fractional systems, many seeds at once. scenarios, gyroscope: data with
its truth, and the filters' settings. runs: the engine over every seed and length L, squared errors, runs that
were lost. timing: table 1. paper_tables: rows beside the paper's numbers, with their percentiles. exchange:
whether tables 3 and 4 are exchanged in print. readings, open_choices: other readings of the algorithm, and
what each choice that the paper leaves open does. figures: PNG. request: what is asked for. report: all of it
in the order of the paper. score: what the guards do.
"""
