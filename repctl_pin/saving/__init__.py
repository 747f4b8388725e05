"""Saving and loading of designs, over a region of joint space or over a cell of the workspace."""

from .save_load import load, load_design, save

__all__ = ["load", "load_design", "save"]
