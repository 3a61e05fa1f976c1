"""The life of a process: signals, children, restarts, threads, its log and its pages by HTTP."""
