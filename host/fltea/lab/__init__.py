"""Experiments: the paper reproduced, noises of known order, the reference."""
