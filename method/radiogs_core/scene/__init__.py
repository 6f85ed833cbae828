"""The scene that a method is run on: cameras, views with their maps, distant light, and colour spaces."""
