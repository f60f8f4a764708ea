"""Properties as sentences, patterns and requirements in FRETish: how they are read, and the formulas they stand for."""
