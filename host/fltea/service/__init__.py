"""The running program: ports, pipelines, outputs, and an orderly end."""
