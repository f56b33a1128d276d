"""What both localisers share: states, reasons and the news of an image (`status.py`)."""
