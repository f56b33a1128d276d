"""The operator's page: `link.py` speaks with the nodes, `teaching.py` records and maps, `page.py` shows it all."""
