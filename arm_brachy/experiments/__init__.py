"""One file per published table or figure, named after it; each returns an evaluation Result."""

EXPERIMENTS = {}
