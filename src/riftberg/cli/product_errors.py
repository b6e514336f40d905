"""``riftberg product-errors``: size and scales of the error of a current, from the differences of two products."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.options import pair
from riftberg.cli.terminal import reported


@reported
def product_errors(
    first: Annotated[Path, typer.Argument(metavar="FIRST", help="File of a product with currents.")],
    second: Annotated[Path, typer.Argument(metavar="SECOND", help="File of another one, of the same days and area.")],
    lon: Annotated[str | None, typer.Option("--lon", metavar="WEST,EAST", help="Box.  [default: what both cover]")] = None,
    lat: Annotated[str | None, typer.Option("--lat", metavar="SOUTH,NORTH", help="Box.")] = None,
) -> None:  # fmt: skip
    """Estimate the error of the current by the differences of two products: size, length, time."""
    from riftberg.ensembles.product_errors import estimated

    found = estimated(first, second, longitude=pair(lon, "--lon"), latitude=pair(lat, "--lat"))
    typer.echo(f"{found.points} points, {found.records} dates; half of the squared difference, if both err alike:")
    typer.echo("  " + " ".join(f"--vary '{text}'" for text in found.vary))
    typer.echo("  A lower bound: errors that both products share are not in their difference.")
