// Milliseconds from a sentence to joints on one thread of WebAssembly: npm run bench -- MODEL_FOLDER
// Times in processor time (cpu) and on the clock (wall): the least and the median of the runs.

import { load } from "./src/node.js";

const [folder, runtime] = process.argv.slice(2);
const RUNS = 20;

function summary(values) {
  const sorted = values.toSorted((a, b) => a - b);
  const middle = sorted[Math.floor(sorted.length / 2)];
  return `least ${sorted[0].toFixed(1)}, median ${middle.toFixed(1)}`;
}

async function timed(task) {
  const [started, before] = [performance.now(), process.cpuUsage()];
  await task();
  const { user, system } = process.cpuUsage(before);
  return { wall: performance.now() - started, cpu: (user + system) / 1000 };
}

let lm = null;
const opened = await timed(async () => (lm = await load(folder, { runtime })));
console.log(`load: ${opened.wall.toFixed(0)} ms wall, ${opened.cpu.toFixed(0)} ms cpu`);
for (const steps of lm.model.steps) {
  for (const seconds of [4, 9.8]) {
    const ask = (seed) => lm.generate("a person walks forward and waves", { seconds, seed, steps });
    for (let seed = 0; seed < 5; seed++) await ask(seed); // until the code is compiled well
    const runs = [];
    for (let seed = 0; seed < RUNS; seed++) runs.push(await timed(() => ask(seed)));
    const cpu = summary(runs.map((run) => run.cpu));
    const wall = summary(runs.map((run) => run.wall));
    console.log(`${steps} steps, ${seconds} s: cpu ${cpu}; wall ${wall}`);
  }
}
await lm.close();
