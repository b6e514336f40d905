"""Everything around the bergs: grids and interpolation, forcing by formula or from files, readers of data products."""
