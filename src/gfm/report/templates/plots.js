// A finger that moves over a picture scrolls the page: it neither zooms nor meets small buttons.
const touched = matchMedia("(pointer: coarse)").matches;
const settings = {
  responsive: true,
  displayModeBar: touched ? false : undefined,
  displaylogo: false,
  // Named one by one: some of the default buttons would send the data elsewhere.
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
};
const digits = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%.()*+-;,=>?@^_`{|}~";
const value = new Uint8Array(128);
[...digits].forEach((digit, i) => { value[digit.charCodeAt(0)] = i; });

// The other side of `packed` in page.py: five digits are four bytes, big end first.
async function unpacked(text) {
  const bytes = new DataView(new ArrayBuffer(4 * Math.ceil(text.length / 5)));
  for (let i = 0; i < text.length; i += 5) {
    let number = 0;
    for (let j = i; j < i + 5; j++) number = 85 * number + (j < text.length ? value[text.charCodeAt(j)] : 84);
    bytes.setUint32(4 * i / 5, number);
  }
  const length = Math.floor(4 * text.length / 5);
  const zipped = new Blob([bytes.buffer.slice(0, length)]).stream();
  return new Response(zipped.pipeThrough(new DecompressionStream("gzip"))).text();
}

let plotly;
function loaded() {
  plotly ??= unpacked(document.getElementById("plotly").textContent).then(code => {
    const script = document.createElement("script");
    script.textContent = code;
    document.head.append(script);
  });
  return plotly;
}

async function draw(plot) {
  seen.unobserve(plot);
  const [text] = await Promise.all([unpacked(plot.nextElementSibling.textContent), loaded()]);
  const {data, layout} = JSON.parse(text);
  if (touched) layout.dragmode = false;
  return Plotly.newPlot(plot, data, layout, settings);
}

const plots = [...document.querySelectorAll(".plot")];
const seen = new IntersectionObserver(entries => entries.filter(e => e.isIntersecting).forEach(e => draw(e.target)), {rootMargin: "400px"});
if (window.DecompressionStream) plots.forEach(plot => seen.observe(plot));
else plots.forEach(plot => { plot.textContent = "This picture needs a browser of 2023 or newer."; });

// On paper nothing is folded, and a page is narrower than the window.
for (const event of ["beforeprint", "afterprint"]) {
  window.addEventListener(event, () => {
    if (event === "beforeprint") document.querySelectorAll("details").forEach(d => { d.open = true; });
    plots.filter(plot => plot.data).forEach(Plotly.Plots.resize);
  });
}
