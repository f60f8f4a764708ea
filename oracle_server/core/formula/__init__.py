"""Past-time MTL in Reelay's Rye syntax: a tree, its grammar, its printer and what can be read off it."""
