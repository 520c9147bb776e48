const settings = {
  responsive: true,
  displaylogo: false,
  // Named one by one: some of the default buttons would send the data elsewhere.
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
};
for (const plot of document.querySelectorAll(".plot")) {
  const {data, layout} = JSON.parse(plot.nextElementSibling.textContent);
  Plotly.newPlot(plot, data, layout, settings);
}
// The page of a printer is narrower than the window.
for (const event of ["beforeprint", "afterprint"]) {
  window.addEventListener(event, () => document.querySelectorAll(".plot").forEach(Plotly.Plots.resize));
}
