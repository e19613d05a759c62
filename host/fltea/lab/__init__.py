"""Run experiments: reproduce the paper, simulate noises of known order, compare with a reference."""
