"""The commands correlate, identify and export."""

from typing import Any

from brake_fenicsx.commands import ALLOW, DIRECTORY, SCENE, SET, argument, command, folder_of

PART = argument("--part", metavar="NAME", help="the part, where the scene has several")
HELD = "with the supports, springs and masses of the part's faces; free if not given"
SUPPORTED = argument("--supported", action="store_true", help=HELD)


@command(
    SCENE, SET, ALLOW,
    argument("test", metavar="TEST.unv", help="universal file: nodes and modes (55) or frequency"
             " responses (58); or a table of points, for responses of the model alone"),
    PART, SUPPORTED, folder_of("correlation"),
)  # fmt: skip
def correlate(options: Any, comm: Any) -> str:
    """Compare modes or frequency responses of a part of a scene with those of a modal test."""
    from .response_study import studies

    given = options.scene, options.test, options.part, options.supported
    write = comm.rank == 0
    return "\n\n".join(
        study(*given, options.directory, options.set, write=write)
        for study in studies(options.test)
    )


@command(
    SCENE, SET, ALLOW,
    argument("--peaks", required=True, metavar="PEAKS.csv", help="table with the column"
             " frequency_hz or frequency_khz, and q, specimen if there are any; or a universal file"
             " of modes (55)"),
    argument("--material", metavar="NAME", help="the material, if not the lining"),
    argument("--prior", type=float, default=30.0, metavar="PERCENT",
             help="standard deviation of each constant around the scene's; %(default)s"),
    argument("--error", type=float, default=0.5, metavar="PERCENT",
             help="standard deviation of a frequency, model and measurement; %(default)s"),
    argument("--write", metavar="FILE.toml", help="put the identified constants"
             " into the scene file: the scene itself, or a new file beside it"),
    PART, SUPPORTED, folder_of("identified"),
)  # fmt: skip
def identify(options: Any, comm: Any) -> str:
    """Identify the constants of a part's material from the frequencies of its resonances."""
    from .identify import identify as identified

    given = options.scene, options.peaks, options.part, options.material, options.supported
    scatter = 0.01 * options.prior, 0.01 * options.error
    last = options.directory, options.set, comm.rank == 0, options.write
    return identified(*given, *scatter, *last)


@command(DIRECTORY, alone=True)
def export(options: Any, comm: Any) -> str:
    """Write the stored mode shapes of a results folder as a universal file, modes.unv."""
    from .universal import export_modes

    return f"wrote {export_modes(options.directory)}"
