"""What a process needs to run: libraries, ranks, signals, logs, files. Nothing of the finger."""
