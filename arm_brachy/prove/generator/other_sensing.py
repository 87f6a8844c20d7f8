"""Other laws of the effects in the sensors; functions as in `sensing`."""

OTHER_SENSING = {}
