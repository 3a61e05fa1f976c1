"""Code that several processes share; docs/architecture.md has the order of its folders."""
