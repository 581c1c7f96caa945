"""Contacts of simple shapes in closed form."""
