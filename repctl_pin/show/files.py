"""Files written whole or not at all: see :mod:`repctl_pin.files`."""

from ..files import prepare_folder, write_whole

__all__ = ["prepare_folder", "write_whole"]
