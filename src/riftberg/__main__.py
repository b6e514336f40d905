"""``python -m riftberg`` is ``riftberg``."""

from riftberg.cli.main import app

if __name__ == "__main__":
    app(prog_name="riftberg")
