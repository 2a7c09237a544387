"""Undo and redo. Scenes do not change, so that the history is the scenes themselves."""

from ..scene.scene import Scene

# Steps that are kept
KEPT = 200


class History:
    """The scenes that there were, and which of them is now."""

    def __init__(self, scene: Scene) -> None:
        self.first = scene
        self._scenes = [scene]
        self._now = 0

    @property
    def scene(self) -> Scene:
        return self._scenes[self._now]

    @property
    def can_undo(self) -> bool:
        return self._now > 0

    @property
    def can_redo(self) -> bool:
        return self._now + 1 < len(self._scenes)

    def keep(self, scene: Scene) -> None:
        """Another scene is now; what was undone is forgotten. The same numbers are no step."""
        if scene == self.scene:
            # Which parameters were touched may differ, and with it what is compiled
            self._scenes[self._now] = scene
            return
        self._scenes = [*self._scenes[: self._now + 1], scene][-KEPT:]
        self._now = len(self._scenes) - 1

    def undo(self) -> None:
        self._now -= self.can_undo

    def redo(self) -> None:
        self._now += self.can_redo
