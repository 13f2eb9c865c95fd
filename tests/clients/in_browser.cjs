// Opens a .glb or .fbx in three.js in headless Chromium: `node in_browser.cjs JOB.json`, with NODE_PATH.
// The job: `path`, `chromium`, `modules`, `page`, `times`, `pictures` as (take, seconds, path), `result`.
const fs = require("fs");
const http = require("http");
const path = require("path");
const { chromium } = require("playwright-core");

const TYPES = { ".js": "text/javascript", ".html": "text/html", ".glb": "model/gltf-binary" };

function serve(job) {
  const server = http.createServer((request, response) => {
    const address = decodeURIComponent(request.url.split("?")[0]);
    const file =
      address === "/" ? job.page
      : address.startsWith("/a.") ? job.path
      : path.join(job.modules, path.normalize(address));
    if (!fs.existsSync(file)) return response.writeHead(404).end();
    response.writeHead(200, { "Content-Type": TYPES[path.extname(file)] || "text/plain" });
    response.end(fs.readFileSync(file));
  });
  return new Promise((done) => server.listen(0, "127.0.0.1", () => done(server)));
}

async function main() {
  const job = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
  const server = await serve(job);
  const browser = await chromium.launch({
    executablePath: job.chromium,
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  });
  const page = await browser.newPage({ viewport: { width: 480, height: 360 } });
  const errors = [];
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("console", (line) => ["error", "warning"].includes(line.type()) && errors.push(line.text()));
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  await page.waitForFunction("window.ready");
  if (job.fade) {
    const { names, hold, blend, pictures } = job.fade;
    await page.exposeFunction("photograph", (n) => page.screenshot({ path: pictures[n] }));
    const about = ["/a.glb", names, hold, blend, Object.keys(pictures).map(Number)];
    const frames = await page.evaluate((given) => window.fade(...given), about);
    fs.writeFileSync(job.result, JSON.stringify({ frames, errors }));
    await browser.close();
    return server.close();
  }
  const result = await page.evaluate(([a, t]) => window.play(a, t), ["/a" + path.extname(job.path), job.times]);
  result.lowest = [];
  for (const [take, time, picture] of job.pictures) {
    result.lowest.push(await page.evaluate(([n, t]) => window.draw(n, t), [take, time]));
    await page.screenshot({ path: picture });
  }
  fs.writeFileSync(job.result, JSON.stringify({ ...result, errors }));
  await browser.close();
  server.close();
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
