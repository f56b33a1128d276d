"""Pyramids, references and the choice of their pixels."""
