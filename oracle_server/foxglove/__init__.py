"""Sessions as Foxglove and other tools draw them: channels of JSON, in files and live."""
