// Long computations as steps: all at once, or in slices between which the page lives on.

const SLICE = 8; // milliseconds, on a slow machine a few times that

/** Returns the result of a generator, run to its end. */
export function atOnce(steps) {
  let step = steps.next();
  while (!step.done) step = steps.next();
  return step.value;
}

/** The same, with tasks of the page in between. */
export async function inSlices(steps) {
  let due = performance.now() + SLICE;
  for (let step = steps.next(); ; step = steps.next()) {
    if (step.done) return step.value;
    if (performance.now() < due) continue;
    await nextTask();
    due = performance.now() + SLICE;
  }
}

// A message, since hidden pages wait a second for timers.
function nextTask() {
  const { port1, port2 } = new MessageChannel();
  return new Promise((go) => {
    port1.onmessage = () => {
      port1.close();
      go();
    };
    port2.postMessage(0);
  });
}
