"""A run: its folder, its networks and its table of epochs on disk; joining it over the network; and
the rules that its settings obey together, which know the sizes of messages too."""
