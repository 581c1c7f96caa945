"""Newton's method for Coulomb's law: the equation of P. Alart and A. Curnier (1991), cases held or free."""
