for (const plot of document.querySelectorAll(".plot")) {
  const {data, layout} = JSON.parse(plot.nextElementSibling.textContent);
  Plotly.newPlot(plot, data, layout, {responsive: true, displaylogo: false, showLink: false});
}
// The page of a printer is narrower than the window.
for (const event of ["beforeprint", "afterprint"]) {
  window.addEventListener(event, () => document.querySelectorAll(".plot").forEach(Plotly.Plots.resize));
}
