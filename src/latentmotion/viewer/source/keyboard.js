// Keys: space, arrows, Home, End, [ ], f, r, 0-9, + -, ?.

/** Listens to the whole page; fields that type for themselves keep their keys. */
export function listenToKeys(timeline, stage, panel, frame) {
  const keys = {
    " ": () => timeline.play(!timeline.playing),
    ArrowLeft: () => step(-1),
    ArrowRight: () => step(1),
    ArrowUp: () => stage.zoom(0.9),
    ArrowDown: () => stage.zoom(1.1),
    Home: () => timeline.seek(0),
    End: () => timeline.seek(timeline.seconds),
    "[": () => timeline.faster(-1),
    "]": () => timeline.faster(1),
    f: () => panel.follow(),
    r: () => stage.reset(),
    "?": () => panel.help(),
    h: () => panel.help(),
  };
  for (let take = 0; take <= 9; take++) keys[take] = () => panel.watch(take ? take - 1 : null);

  function step(frames) {
    timeline.play(false);
    timeline.seek((Math.round(timeline.time / frame) + frames) * frame);
  }

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTheirs(event)) return;
    const turned = event.shiftKey && { ArrowLeft: -0.12, ArrowRight: 0.12 }[event.key];
    const action = turned ? () => stage.turn(turned) : keys[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
}

// A focused button answers the space bar itself, and the list of speeds its own arrows.
function isTheirs({ key, target }) {
  if (document.getElementById("keys").open) return key !== "?" && key !== "h";
  return target.tagName === "SELECT" || (target.tagName === "BUTTON" && key === " ");
}
