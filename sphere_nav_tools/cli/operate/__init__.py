"""The operator's page: `link.py` speaks with the nodes, `teaching.py` runs recorder and mapper, `page.py` shows all."""
