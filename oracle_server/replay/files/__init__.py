"""The files of recordings, as far as they are whole: containers, folders, and what lies in them."""
