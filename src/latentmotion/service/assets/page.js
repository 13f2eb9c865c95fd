// The service's page: a prompt goes to /v1/motions, the answer to the viewer in the frame.

const find = (id) => document.getElementById(id);
let shown = null;

async function motion(format, asked) {
  const headers = { "Content-Type": "application/json" };
  if (find("token").value) headers.Authorization = `Bearer ${find("token").value}`;
  const body = JSON.stringify({ ...asked, format });
  const answer = await fetch("/v1/motions", { method: "POST", headers, body });
  if (answer.ok) return answer;
  if (answer.status === 401) find("secret").hidden = false;
  const problem = await answer.json().catch(() => ({ detail: answer.statusText }));
  throw new Error(problem.detail);
}

function tell(text, wrong = false) {
  find("told").textContent = text;
  find("told").classList.toggle("wrong", wrong);
}

// The viewer reads its motions once, as it is loaded: each motion gets a new one.
function show(motions) {
  const frame = find("view");
  frame.onload = () => frame.contentWindow.postMessage(motions, location.origin);
  frame.src = "/viewer";
}

async function busy(work) {
  const buttons = document.querySelectorAll("button");
  buttons.forEach((button) => (button.disabled = true));
  try {
    await work();
  } catch (error) {
    tell(error.message, true);
  } finally {
    buttons.forEach((button) => (button.disabled = false));
  }
}

find("ask").addEventListener("submit", (event) => {
  event.preventDefault();
  const asked = { prompt: find("prompt").value, seed: Number(find("seed").value) };
  if (find("seconds").value) asked.seconds = Number(find("seconds").value);
  busy(async () => {
    tell("…");
    const start = performance.now();
    const answer = await motion("viewer", asked);
    show(await answer.text());
    shown = asked;
    find("files").hidden = false;
    const model = answer.headers.get("LatentMotion-Model");
    const license = answer.headers.get("LatentMotion-License");
    tell(`${model}, ${Math.round(performance.now() - start)} ms; weights of the model: ${license}`);
  });
});

find("files").addEventListener("click", (event) => {
  const format = event.target.value;
  if (!format) return;
  busy(async () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await (await motion(format, shown)).blob());
    link.download = `motion.${format}`;
    link.click();
    URL.revokeObjectURL(link.href);
  });
});
