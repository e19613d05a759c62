"""A running program: ports, pipelines, outputs, an orderly end."""
