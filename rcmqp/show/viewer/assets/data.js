// What the page carries, taken apart: scripts, and numbers by name.

function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const letters = atob(text); // in browsers before 2025
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

async function inflate(id) {
  const element = document.getElementById(id);
  const bytes = fromBase64(element.textContent);
  element.remove();
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function runScript(bytes) {
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(bytes);
  document.head.append(script);
}

function readData(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const data = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const start = 4 + size;
  const floats = (entry) =>
    new Float32Array(buffer, start + entry.at, entry.shape.reduce((a, b) => a * b, 1));
  data.arm.commands = data.arm.commands.map((c) => new Uint8Array(buffer, start + c.at, c.size));
  for (const run of data.runs) {
    for (const name in run.frames) run.frames[name] = floats(run.frames[name]);
    for (const name in run.curves) run.curves[name] = run.curves[name].map(floats);
  }
  return data;
}

// Where a time falls in an array that rises: the frame before, and how far it is to the next; at
// the last frame, or alone, it is 0.
function place(times, t) {
  let low = 0;
  let high = times.length - 1;
  if (t <= times[0]) return [0, 0];
  if (t >= times[high]) return [high, 0];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return [low, (t - times[low]) / (times[high] - times[low])];
}

// Row of an array of frames at a time, straight between the frames before and after it. Missing
// numbers (NaN) do not reach into frames that have them.
function sample(run, name, t) {
  const array = run.frames[name];
  const width = array.length / run.frames.time.length;
  const [row, share] = place(run.frames.time, t);
  return Array.from({ length: width }, (_, i) => {
    const at = row * width + i;
    return share === 0 ? array[at] : array[at] + share * (array[at + width] - array[at]);
  });
}
