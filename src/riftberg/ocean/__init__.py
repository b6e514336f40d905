"""What acts on the bergs: grids, cells and interpolation, forcing by formula and from files."""
