"""Scenes where methods fail, each with a number that says how badly: run over schemes and steps by `mbvi stress`."""
