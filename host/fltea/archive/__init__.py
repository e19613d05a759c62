"""Records, summarises and exports whole recordings."""
