"""``riftberg fetch``: the inputs of the published run, and original products through their own clients."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.options import Quiet, dates, pair, positive
from riftberg.cli.output import results_folder
from riftberg.cli.terminal import reported
from riftberg.errors import InputError

PRODUCTS = ("oscar", "glorys", "duacs", "era5", "ncep-r1", "gebco")


@reported
def fetch(
    what: Annotated[str, typer.Argument(help=f"a68a (inputs of the published run, 1.3 GB), or {', '.join(PRODUCTS)}.")],
    folder: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder.  [default: riftberg-data/NAME]")
    ] = None,
    lon: Annotated[str | None, typer.Option("--lon", metavar="WEST,EAST", help="Longitudes, for products.")] = None,
    lat: Annotated[str | None, typer.Option("--lat", metavar="SOUTH,NORTH", help="Latitudes, for products.")] = None,
    time: Annotated[
        str | None, typer.Option("--time", metavar="FIRST,LAST", help="Days, for products; gebco needs none.")
    ] = None,
    fields: Annotated[
        str | None,
        typer.Option(
            "--fields",
            metavar="FIELD,...",
            help="era5: wind, waves, ice; glorys: currents, ssh, ice; duacs: ssh, currents.  "
            "[default: wind; currents,ssh; ssh]",
        ),
    ] = None,
    depth: Annotated[float, typer.Option("--depth", help="Deepest level (m), for products with levels.")] = 250.0,
    small: Annotated[bool, typer.Option("--small", help="a68a: only the small files, no hourly fields.")] = False,
    quiet: Quiet = False,
) -> None:
    """Download forcing files; an interrupted download resumes where it stopped."""
    positive(depth, "--depth", "m", most=12_000.0)
    folder = folder or Path("riftberg-data") / what
    if what == "a68a":
        from riftberg.fetching.fetch import HOURLY, fetch_a68a

        with results_folder(folder):
            paths = fetch_a68a(folder, hourly=() if small else HOURLY, progress=not quiet)
    elif what in PRODUCTS:
        from riftberg.fetching.services import fetch_product

        box, span = (pair(lon, "--lon"), pair(lat, "--lat")), dates(time)
        if box[0] is None or box[1] is None:
            raise InputError("a box is needed", where=f"fetch {what}", remedy="For example --lon -43,-33 --lat -59,-53")
        if span is None and what != "gebco":
            raise InputError(
                "days are needed", where=f"fetch {what}", remedy="For example --time 2020-12-09,2020-12-25"
            )
        chosen = tuple(field.strip() for field in fields.split(",")) if fields else ()
        with results_folder(folder):
            paths = fetch_product(what, folder, *box, span, fields=chosen, depth=depth, progress=not quiet)  # type: ignore[arg-type]
    else:
        raise InputError(f"{what!r} is not known", where="fetch", remedy=f"Use a68a, {', '.join(PRODUCTS)}")
    for path in paths:
        typer.echo(path)
