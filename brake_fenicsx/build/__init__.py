"""A scene made into numbers: the only folder that knows both the scene and the mechanics."""
