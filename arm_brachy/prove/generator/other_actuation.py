"""Other laws between an encoder and its pad; functions as in `actuation`."""

OTHER_ACTUATION = {}
