"""Virtual navigation in a browser (M15 section 6.3.2): `server.py` is the page, `drive.py` feeds it."""
