"""Errors a person can act on: one line with what was got, what is allowed, where, what to do."""


class ArmBrachyError(Exception):
    """Base of every expected error; the command line prints it in one line.

    exit_status : 1 when the work ran and the news is bad, 2 when the input was bad.
    """

    exit_status = 1


class InputError(ArmBrachyError):
    """Something a person supplied is wrong (file, key, value, unit)."""

    exit_status = 2


class ConfigError(InputError):
    """A scene, scenario or column map that does not satisfy its schema."""


class MeshError(InputError):
    """A mesh or surface that cannot carry a simulation."""


class RecordingError(InputError):
    """A bag or laboratory file that cannot be read as claimed."""


class CommandRefused(InputError):
    """A command to a device outside what the device allows; the device keeps its last target."""


class NotConverged(ArmBrachyError):
    """A solver stopped short of its tolerance; the state it had is not passed on."""


class Interrupted(ArmBrachyError):
    """A person ended the work; what was done until then is kept."""

    exit_status = 130  # 128 + SIGINT, as shells have it
