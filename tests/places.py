"""Folders and scenes of the checkout that many tests use."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "scripts"
SCENES = SCRIPTS / "scenes"
BLOCK = SCENES / "block_on_plate.toml"
SQUEALING = SCENES / "squealing_block.toml"
DEMO = SCENES / "disc_brake_demo.toml"
WHOLE = SCENES / "whole_brake.toml"
VENTED = SCENES / "vented_brake.toml"
PAD = SCENES / "pad_scan.npz"
