"""Tests of pictures, films and the replay page."""
